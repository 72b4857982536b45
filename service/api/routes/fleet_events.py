"""What happens in the fleet, as it happens."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Response
from starlette.concurrency import run_in_threadpool

from service.api.auth import TabletActor
from service.api.deps import KernelDep
from service.api.live import RETRY, BroadcastDep, EventStream, Listener, Topic, event_message
from service.domain.access import Actor
from service.usecases.fleet_events import FleetEvent, Past, listen
from service.usecases.kernel import Kernel

router = APIRouter(prefix="/v1", tags=["robots"])

_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Events named `publication` and `report`, each as JSON in `data`; ids sort by time.",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}


@router.get("/events", response_class=Response, responses=_EVENTS)
async def listen_to_the_fleet(
    kernel: KernelDep,
    broadcast: BroadcastDep,
    actor: TabletActor,
    *,
    map_id: Annotated[str | None, Query(alias="map", description="Only what happens on this map.")] = None,
    last_event_id: Annotated[
        str | None, Header(description="`id` of the last event seen; a client that reconnects sends it.")
    ] = None,
) -> Response:
    """Listen to the fleet as server-sent events: pointers that move, and what robots report, from now on.

    After a reconnect with `Last-Event-ID` nothing is missing; events of the last seconds before may come
    again, under the same ids. The stream ends within five seconds of its key. Needs a tablet or admin key.
    """
    with broadcast.joined(actor, Topic(map_id=map_id)) as listener:
        past = await run_in_threadpool(_past, kernel, actor, map_id, last_event_id)
    return EventStream(broadcast, listener, _frames(kernel, listener, past))


async def _frames(kernel: Kernel, listener: Listener, past: Past) -> AsyncIterator[bytes]:
    yield RETRY
    while events := await run_in_threadpool(_page, kernel, past):
        for event in events:
            yield event_message(event).frame
    async for message in listener.messages():
        if not message.mark or past.is_news(message.mark):
            yield message.frame


def _past(kernel: Kernel, actor: Actor, map_id: str | None, after: str | None) -> Past:
    with kernel.db.reading() as session:
        return listen(session, actor, map_id=map_id, after=after, now=kernel.now())


def _page(kernel: Kernel, past: Past) -> list[FleetEvent]:
    with kernel.db.reading() as session:
        return past.page(session)
