"""What a robot polls: the revision that it should run."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.auth import Presented
from service.api.conditions import listed, match, none_match
from service.api.deps import MapId
from service.api.polling import Polling
from service.api.problems import base_url_of
from service.api.schemas.revisions import Channel, PublishedOut
from service.api.unchanged import POINTER_CACHING
from service.domain.errors import PointerMoved
from service.usecases.kernel import Kernel
from service.usecases.polling import Polled, poll
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
    channel: Annotated[
        Channel | None,
        Query(description="By default the one that the robot follows, for its own key; else `stable`."),
    ] = None,
    if_none_match: Annotated[
        str | None, Header(description="ETag of the last answer: then 304 says that nothing has changed.")
    ] = None,
) -> Response:
    """Tell which revision a robot should run, with its files. Made to be polled: send `If-None-Match`.

    That is what the channel points to, or what a roll-out gives the robot whose own key asks.
    """
    polling: Polling = request.app.state.polling
    secret = None if presented is None else presented.credentials
    token = polling.token()
    found, answer = await run_in_threadpool(_from_database, request, secret, (map_id, channel), if_none_match)
    assert secret is not None
    polling.remember(token, secret, found)
    return answer


def _from_database(
    request: Request, secret: str | None, place: tuple[str, str | None], if_none_match: str | None
) -> tuple[Polled, Response]:
    kernel: Kernel = request.app.state.kernel
    with kernel.db.reading() as session:
        found = poll(session, secret, map_id=place[0], channel=place[1], now=kernel.now())
        wanted = listed(request, "if-match")
        if wanted is not None and not match(wanted, found.tag):
            raise PointerMoved("The channel is not where If-Match says.", revision=found.n)
        if not none_match(if_none_match, found.tag):
            return found, Response(status_code=304, headers=_headers(found.tag))
        told = PublishedOut.of(published(session, found.pointer, n=found.n), base_url=base_url_of(request))
    headers = _headers(found.tag)
    return found, Response(told.model_dump_json(), headers=headers, media_type="application/json")


def _headers(tag: str) -> dict[str, str]:
    return {"ETag": f'"{tag}"', "Cache-Control": POINTER_CACHING}
