"""Files of a ready revision, on their way to a robot."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import urlsplit

from fastapi import APIRouter, Path, Request, Response

from service.api.auth import AnyActor
from service.api.deps import BaseUrl, KernelDep, MapId, RevisionN
from service.api.downloads import DOCUMENTED, IMMUTABLE, send_file
from service.usecases.download import CLOUD_PATH, artifact_file

router = APIRouter(prefix="/v1/maps/{map_id}", tags=["downloads"])

ArtifactPath = Annotated[str, Path(description="Path of the file, such as `point-cloud.pcd`.")]


@router.head("/revisions/{n}/artifacts/{path:path}", include_in_schema=False)
@router.get("/revisions/{n}/artifacts/{path:path}", response_class=Response, responses=DOCUMENTED)
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
    where a broken download ended. `Accept-Encoding: zstd` saves about half of the large ones; such an
    answer has an ETag of its own and no ranges. HEAD works too.
    """
    with kernel.db.reading() as session:
        file = artifact_file(kernel, session, actor, map_id=map_id, n=n, path=path)
    later = f"{urlsplit(base_url).path}/v1/maps/{map_id}/revisions/*/artifacts/{path}"
    dictionary_for = later if path == CLOUD_PATH else None
    return send_file(request, file, caching=IMMUTABLE, dictionary_for=dictionary_for)
