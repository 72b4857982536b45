"""Find the bytes of a file that may be downloaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from service.db.models import Artifact
from service.db.revisions import find_artifact, find_blob
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import ArtifactNotFound
from service.usecases.kernel import Kernel
from service.usecases.revisions import ready_revision

CLOUD_PATH = "point-cloud.pcd"
"""The map's cloud among the files of a revision."""

CODED_SUFFIX = ".zst"
"""What the name of a file ends with that is another file of the same revision, compressed by zstd."""


@dataclass(frozen=True)
class CodedForm:
    """Hold a file as it goes out under a content coding.

    Parameters
    ----------
    coding : str
        As `Content-Encoding` names it.
    path : Path
        Where the coded bytes lie.
    head : bytes
        What goes out before them.
    sha256 : str
        SHA-256 (hex) of the head and the coded bytes.
    size_bytes : int
        Size of both.
    """

    coding: str
    path: Path
    sha256: str
    size_bytes: int
    head: bytes = b""


@dataclass(frozen=True)
class StoredFile:
    """Hold a file as it goes out: where its bytes lie, their SHA-256 (hex) and size, and what they are.

    `forms` are the codings that it is at hand in, the smallest first.
    """

    path: Path
    sha256: str
    size_bytes: int
    media_type: str
    file_name: str
    forms: tuple[CodedForm, ...] = ()


def stored_file(
    kernel: Kernel, session: Session, *, sha256: str | None, file_name: str, media_type: str | None = None
) -> StoredFile:
    """Return a blob as a file to download.

    Parameters
    ----------
    sha256 : str, optional
        None when the row that names the file has none yet.
    media_type : str, optional
        By default what the blob was stored as.

    Raises
    ------
    ArtifactNotFound
        If there is no such file (yet).
    """
    blob = None if sha256 is None else find_blob(session, sha256)
    if blob is None:
        raise ArtifactNotFound(f"There is no {file_name} yet: the job that makes it has not succeeded.")
    path = kernel.blobs.path(blob.sha256)
    return StoredFile(path, blob.sha256, blob.size_bytes, media_type or blob.media_type, file_name)


def artifact_file(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int, path: str
) -> StoredFile:
    """Return a file of a ready revision, in every coding that it is stored in.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady
        As `ready_revision`.
    ArtifactNotFound
        If the revision has no such file.
    """
    revision = ready_revision(session, actor, map_id=map_id, n=n)
    found = find_artifact(session, revision.id, path=path)
    if found is None:
        raise ArtifactNotFound(f"Revision {n} has no file {path!r}; list its artifacts.")
    coded = find_artifact(session, revision.id, path=path + CODED_SUFFIX)
    return StoredFile(
        kernel.blobs.path(found.sha256),
        found.sha256,
        found.size_bytes,
        found.media_type,
        found.path.rpartition("/")[2],
        forms=() if coded is None else (_zstd(kernel, coded),),
    )


def _zstd(kernel: Kernel, coded: Artifact) -> CodedForm:
    return CodedForm("zstd", kernel.blobs.path(coded.sha256), coded.sha256, coded.size_bytes)
