"""What happens in the fleet, as it happens."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Annotated, Any

import anyio
from anyio.to_thread import run_sync
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import StreamingResponse

from service.api.auth import TabletActor
from service.api.deps import KernelDep
from service.domain.errors import DatabaseBusy
from service.usecases.fleet_events import FleetEvent, Listening, listen
from service.usecases.kernel import Kernel

router = APIRouter(prefix="/v1", tags=["robots"])

_LOOK_EVERY_S = 0.5
_KEEP_ALIVE_S = 10.0
_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Events named `publication` and `report`, each as JSON in `data`; ids sort by time.",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}


@router.get("/events", response_class=Response, responses=_EVENTS)
def listen_to_the_fleet(
    request: Request,
    kernel: KernelDep,
    actor: TabletActor,
    *,
    map_id: Annotated[str | None, Query(alias="map", description="Only what happens on this map.")] = None,
    last_event_id: Annotated[
        str | None, Header(description="`id` of the last event seen; a client that reconnects sends it.")
    ] = None,
) -> Response:
    """Listen to the fleet as server-sent events: pointers that move, and what robots report, from now on.

    After a reconnect with `Last-Event-ID` nothing is missing; events of the last seconds before may come
    again, under the same ids. Needs a tablet or admin key.
    """
    with kernel.db.reading() as session:
        listening = listen(session, actor, map_id=map_id, after=last_event_id, now=kernel.now())
    return StreamingResponse(
        _stream(request, kernel, listening),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _stream(request: Request, kernel: Kernel, listening: Listening) -> AsyncIterator[bytes]:
    quiet_s = 0.0
    yield b"retry: 1000\n\n"
    while not request.app.state.stopping.is_set():
        try:
            events = await run_sync(_look, kernel, listening)
        except DatabaseBusy:
            events = []
        for event in events:
            quiet_s = 0.0
            yield _line(event)
        if quiet_s >= _KEEP_ALIVE_S:
            quiet_s = 0.0
            yield b": still here\n\n"
        await anyio.sleep(_LOOK_EVERY_S)
        quiet_s += _LOOK_EVERY_S


def _look(kernel: Kernel, listening: Listening) -> list[FleetEvent]:
    with kernel.db.reading() as session:
        return listening.look(session, now=kernel.now())


def _line(event: FleetEvent) -> bytes:
    told = {"id": event.id, "map_id": event.map_id, "at": event.at.isoformat(), **event.told}
    return f"event: {event.kind}\nid: {event.id}\ndata: {json.dumps(told)}\n\n".encode()
