"""Give the files of a result their rows."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePosixPath

from service.db.blobs import record_blob
from service.db.models import Artifact
from service.db.session import Session
from service.storage.blobs import Stored
from service.usecases.kernel import Kernel

_MEDIA_TYPES = {
    ".geojson": "application/geo+json",
    ".bin": "application/octet-stream",
    ".json": "application/json",
    ".npy": "application/octet-stream",
    ".npz": "application/octet-stream",
    ".pcd": "application/octet-stream",
    ".pgm": "image/x-portable-graymap",
    ".png": "image/png",
    ".tar": "application/x-tar",
    ".yaml": "application/yaml",
    ".zst": "application/zstd",
}


def media_type(name: str) -> str:
    """Return the media type of a file that the product itself writes.

    Raises
    ------
    KeyError
        If the product writes no such file.
    """
    return _MEDIA_TYPES[PurePosixPath(name).suffix]


def artifact_rows(revision_id: str, files: Mapping[str, Stored]) -> list[Artifact]:
    """Return the rows that name blobs as the files of a revision, by their path."""
    return [
        Artifact(
            revision_id=revision_id,
            path=path,
            sha256=stored.sha256,
            size_bytes=stored.size_bytes,
            media_type=media_type(path),
        )
        for path, stored in sorted(files.items())
    ]


def record_files(kernel: Kernel, session: Session, files: Mapping[str, Stored]) -> None:
    """Record the blobs of a result, by file name; their bytes are in the store already."""
    for name, stored in sorted(files.items()):
        record_blob(
            session,
            stored.sha256,
            size_bytes=stored.size_bytes,
            media_type=media_type(name),
            now=kernel.now(),
        )
