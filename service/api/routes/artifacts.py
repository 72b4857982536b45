"""Files of a ready revision, on their way to a robot."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated
from urllib.parse import urlsplit

from fastapi import APIRouter, Path, Query, Request, Response

from service.api.auth import AnyActor
from service.api.codings import dictionary_of, takes
from service.api.deps import BaseUrl, KernelDep, MapId, RevisionN
from service.api.downloads import DOCUMENTED, IMMUTABLE, REVALIDATE, send_file
from service.api.schemas.downloads import ChangesOut, LinkOut
from service.domain.access import Actor
from service.usecases.deltas import delta_file, dictionary_form
from service.usecases.download import CLOUD_PATH, StoredFile, artifact_file
from service.usecases.kernel import Kernel
from service.usecases.links import LONGEST_S, Signature, link_path, linked_file, sign_link
from service.usecases.tile_changes import tile_changes

router = APIRouter(tags=["downloads"])

_REVISION = "/v1/maps/{map_id}/revisions/{n}"
_LINK = "/v1/links/{map_id}/{n}"

ArtifactPath = Annotated[str, Path(description="Path of the file, such as `point-cloud.pcd`.")]
OtherN = Annotated[int, Query(ge=1, le=2**31 - 1, description="Number of the revision that the robot holds.")]


@router.head(_REVISION + "/artifacts/{path:path}", include_in_schema=False)
@router.get(_REVISION + "/artifacts/{path:path}", response_class=Response, responses=DOCUMENTED)
def get_artifact(
    request: Request,
    kernel: KernelDep,
    actor: AnyActor,
    base_url: BaseUrl,
    map_id: MapId,
    n: RevisionN,
    path: ArtifactPath,
) -> Response:
    """Download a file of a ready revision.

    Its ETag is the SHA-256 of its bytes, its content never changes, and `Range` with `If-Range` goes on
    where a broken download ended. `Accept-Encoding: zstd` saves about half of the large ones; for the cloud,
    `dcz` with `Available-Dictionary` sends only what it adds to another cloud of the map (RFC 9842). Such
    answers have an ETag of their own and no ranges. HEAD works too.
    """
    with kernel.db.reading() as session:
        file = artifact_file(kernel, session, actor, map_id=map_id, n=n, path=path)
    if path != CLOUD_PATH:
        return send_file(request, file, caching=IMMUTABLE)
    file = _with_dictionary(request, kernel, actor, file, map_id)
    later = f"{urlsplit(base_url).path}/v1/maps/{map_id}/revisions/*/artifacts/{path}"
    return send_file(request, file, caching=IMMUTABLE, dictionary_for=later)


@router.head(_REVISION + "/delta", include_in_schema=False)
@router.get(_REVISION + "/delta", response_class=Response, responses=DOCUMENTED)
def get_delta(
    request: Request,
    kernel: KernelDep,
    actor: AnyActor,
    map_id: MapId,
    n: RevisionN,
    from_n: Annotated[OtherN, Query(alias="from")],
) -> Response:
    """Download what the cloud of this revision adds to that of another, for zstd.

    `zstd -d --long=31 --patch-from=OLD.pcd` reads it. Made by a job when it is asked for the first time:
    until then the answer is 503 with `Retry-After`. For a robot's key it is made where this revision is
    published, or given to the robot by a roll-out (else 409 `delta-not-offered`: take the tiles or the whole
    file). ETag and ranges as for any file.
    """
    file = delta_file(kernel, actor, map_id=map_id, n=n, from_n=from_n)
    return send_file(request, file, caching=IMMUTABLE)


@router.get(_REVISION + "/changes")
def get_changes(
    kernel: KernelDep, actor: AnyActor, base_url: BaseUrl, map_id: MapId, n: RevisionN, since: OtherN
) -> ChangesOut:
    """Tell which tiles were added, changed and removed since another revision, in the manifest's order."""
    with kernel.db.reading() as session:
        found = tile_changes(kernel, session, actor, map_id=map_id, n=n, since=since)
    return ChangesOut.of(found, map_id=map_id, n=n, since=since, base_url=base_url)


@router.get(_REVISION + "/link")
def get_link(
    kernel: KernelDep,
    actor: AnyActor,
    base_url: BaseUrl,
    map_id: MapId,
    n: RevisionN,
    *,
    path: Annotated[str, Query(max_length=255, description="Path of the file.")],
    valid_s: Annotated[int, Query(ge=1, le=LONGEST_S, description="Seconds until the link expires.")] = 3600,
) -> LinkOut:
    """Sign a link to a file that works without a key until it expires or this key is revoked."""
    with kernel.db.reading() as session:
        signed = sign_link(kernel, session, actor, map_id=map_id, n=n, path=path, valid_s=valid_s)
    return LinkOut(
        url=base_url + link_path(signed.signature, map_id=map_id, n=n, path=path),
        sha256=signed.file.sha256,
        size_bytes=signed.file.size_bytes,
        expires_at=signed.expires_at,
    )


@router.head(_LINK + "/{path:path}", include_in_schema=False)
@router.get(_LINK + "/{path:path}", response_class=Response, responses=DOCUMENTED)
def follow_link(
    request: Request,
    kernel: KernelDep,
    map_id: MapId,
    n: RevisionN,
    path: ArtifactPath,
    *,
    key: Annotated[str, Query(max_length=40, pattern=r"^key_[0-9a-z]+$", description="Whose key signed it.")],
    expires: Annotated[int, Query(ge=0, lt=10**11, description="When it expires, seconds since 1970.")],
    signature: Annotated[str, Query(pattern=r"^[0-9a-f]{64}$", description="The proof.")],
) -> Response:
    """Download a file by a signed link, without a key; conditions, codings and ranges as with one."""
    with kernel.db.reading() as session:
        proof = Signature(key, expires, signature)
        file = linked_file(kernel, session, proof, map_id=map_id, n=n, path=path)
    return send_file(request, file, caching=REVALIDATE)


def _with_dictionary(
    request: Request, kernel: Kernel, actor: Actor, file: StoredFile, map_id: str
) -> StoredFile:
    """Return the file with its form for the dictionary that the request offers, if there is one."""
    held = dictionary_of(request.headers.get("available-dictionary"))
    if held is None or not takes(request.headers.get("accept-encoding"), "dcz"):
        return file
    form = dictionary_form(kernel, actor, map_id=map_id, held_sha256=held, wanted_sha256=file.sha256)
    return file if form is None else replace(file, forms=(form, *file.forms))
