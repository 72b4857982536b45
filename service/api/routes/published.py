"""What a robot polls: the revision that its channel points to."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.auth import Presented
from service.api.conditions import none_match
from service.api.deps import MapId
from service.api.polling import Polling
from service.api.polls import POINTER_CACHING
from service.api.problems import base_url_of
from service.api.schemas.revisions import Channel, PublishedOut
from service.usecases.kernel import Kernel
from service.usecases.polling import Place, Polled, poll
from service.usecases.publish import published

router = APIRouter(prefix="/v1/maps/{map_id}", tags=["revisions"])

_UNCHANGED: dict[int | str, dict[str, Any]] = {
    304: {"description": "The pointer is where `If-None-Match` says."}
}


@router.head("/published", include_in_schema=False)
@router.get("/published", response_model=PublishedOut, responses=_UNCHANGED)
async def get_published(
    request: Request,
    presented: Presented,
    map_id: MapId,
    *,
    channel: Annotated[Channel, Query(description="The channel that this robot follows.")] = "stable",
    if_none_match: Annotated[
        str | None, Header(description="ETag of the last answer: then 304 says that nothing has changed.")
    ] = None,
) -> Response:
    """Tell which revision a robot should run, with its files. Made to be polled: send `If-None-Match`."""
    polling: Polling = request.app.state.polling
    secret = None if presented is None else presented.credentials
    place = (map_id, channel)
    token = polling.token()
    found, answer = await run_in_threadpool(_from_database, request, secret, place, if_none_match)
    assert secret is not None
    polling.remember(token, secret, place, found)
    return answer


def _from_database(
    request: Request, secret: str | None, place: Place, if_none_match: str | None
) -> tuple[Polled, Response]:
    kernel: Kernel = request.app.state.kernel
    with kernel.db.reading() as session:
        found = poll(session, secret, place=place, now=kernel.now())
        if not none_match(if_none_match, found.tag):
            return found, Response(status_code=304, headers=_headers(found.tag))
        told = PublishedOut.of(published(session, found.pointer), base_url=base_url_of(request))
    headers = _headers(found.tag)
    return found, Response(told.model_dump_json(), headers=headers, media_type="application/json")


def _headers(tag: str) -> dict[str, str]:
    return {"ETag": f'"{tag}"', "Cache-Control": POINTER_CACHING}
