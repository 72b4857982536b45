"""What a robot polls: the revision that its channel points to."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Response

from service.api.auth import AnyActor
from service.api.conditions import none_match
from service.api.deps import BaseUrl, KernelDep, MapId
from service.api.schemas.revisions import Channel, PublishedOut
from service.usecases import publish

router = APIRouter(prefix="/v1/maps/{map_id}", tags=["revisions"])

_POINTER_CACHING = "private, no-cache"
_UNCHANGED: dict[int | str, dict[str, Any]] = {
    304: {"description": "The pointer is where `If-None-Match` says."}
}


@router.head("/published", include_in_schema=False)
@router.get("/published", response_model=PublishedOut, responses=_UNCHANGED)
def get_published(
    kernel: KernelDep,
    actor: AnyActor,
    base_url: BaseUrl,
    map_id: MapId,
    *,
    channel: Annotated[Channel, Query(description="The channel that this robot follows.")] = "stable",
    if_none_match: Annotated[
        str | None, Header(description="ETag of the last answer: then 304 says that nothing has changed.")
    ] = None,
) -> Response:
    """Tell which revision a robot should run, with its files. Made to be polled: send `If-None-Match`."""
    with kernel.db.reading() as session:
        pointer = publish.published_pointer(session, actor, map_id=map_id, channel=channel)
        tag = publish.pointer_tag(pointer)
        headers = {"ETag": f'"{tag}"', "Cache-Control": _POINTER_CACHING}
        if not none_match(if_none_match, tag):
            return Response(status_code=304, headers=headers)
        found = PublishedOut.of(publish.published(session, pointer), base_url=base_url)
    return Response(found.model_dump_json(), headers=headers, media_type="application/json")
