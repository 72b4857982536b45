"""Jobs: background work, its progress and its end."""

from __future__ import annotations

from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, Any

import anyio
from anyio.to_thread import run_sync
from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.orm import Session

from service.api.auth import TabletActor
from service.api.deps import BaseUrl, KernelDep, Once, answered, respond
from service.api.schemas.base import Page
from service.api.schemas.jobs import JobOut
from service.api.searching import SearchDep
from service.domain.access import Actor
from service.domain.errors import DatabaseBusy
from service.domain.lifecycle import JobKind, JobState
from service.usecases import jobs
from service.usecases.answer import Answered, answer_once
from service.usecases.find import find_jobs
from service.usecases.kernel import Kernel

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

_LOOK_EVERY_S = 0.2
_KEEP_ALIVE_S = 10.0

JobId = Annotated[str, Path(description="Id of the job.")]
_EVENTS: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "Events named `job`, each with a job as JSON in `data` and a counter as `id`.",
        "content": {"text/event-stream": {"schema": {"type": "string"}}},
    }
}


@router.get("", response_model=Page[JobOut])
def list_jobs(
    kernel: KernelDep,
    actor: TabletActor,
    search: SearchDep,
    base_url: BaseUrl,
    *,
    state: Annotated[JobState | None, Query(description="Only jobs in this state.")] = None,
    kind: Annotated[JobKind | None, Query(description="Only jobs of this kind.")] = None,
) -> Page[JobOut]:
    """List the jobs of the key's maps. Needs a tablet or admin key."""
    with kernel.db.reading() as session:
        rows = find_jobs(session, actor, search.wanted({"state": state, "kind": kind}))
        show = partial(JobOut.of, base_url=base_url)
        return Page[JobOut](**search.paging.page(rows, key=lambda row: row.id, show=show))


@router.get("/{job_id}", response_model=JobOut)
def get_job(kernel: KernelDep, actor: TabletActor, base_url: BaseUrl, job_id: JobId) -> JobOut:
    """Show one job; poll this, or listen to its events."""
    return _look(kernel, actor, job_id, base_url)[0]


@router.post("/{job_id}/cancel", status_code=202, response_model=JobOut)
def cancel_job(
    kernel: KernelDep, actor: TabletActor, once: Once, base_url: BaseUrl, job_id: JobId
) -> Response:
    """Stop a job: at once if it waits, else as soon as its worker hears of it (`cancel_requested`)."""

    def act(session: Session) -> Answered:
        row = jobs.cancel_job(kernel, session, actor, job_id=job_id)
        return answered(JobOut.of(row, base_url=base_url), status=202)

    return respond(answer_once(kernel, actor, point="cancel-job", request=once, act=act))


@router.post("/{job_id}/retry", status_code=202, response_model=JobOut)
def retry_job(
    kernel: KernelDep, actor: TabletActor, once: Once, base_url: BaseUrl, job_id: JobId
) -> Response:
    """Queue a failed or cancelled job anew. A revision that failed stays so: ask for a new one."""

    def act(session: Session) -> Answered:
        row = jobs.retry_job(kernel, session, actor, job_id=job_id)
        return answered(JobOut.of(row, base_url=base_url), status=202)

    return respond(answer_once(kernel, actor, point="retry-job", request=once, act=act))


@router.get("/{job_id}/events", response_class=Response, responses=_EVENTS)
def listen_to_job(
    request: Request,
    kernel: KernelDep,
    actor: TabletActor,
    base_url: BaseUrl,
    job_id: JobId,
    last_event_id: Annotated[
        str | None, Header(description="`id` of the last event seen; a client that reconnects sends it.")
    ] = None,
) -> Response:
    """Listen to a job as server-sent events: its present state at once, then each change, until it ends.

    The stream ends after the event with a final state. After a reconnect with `Last-Event-ID` a state
    that was seen is not sent again, unless it is final.
    """
    first = _look(kernel, actor, job_id, base_url)
    seen = None if last_event_id != str(first[1]) or first[0].state.is_final else first[1]

    async def events() -> AsyncIterator[bytes]:
        yield b"retry: 1000\n\n"
        async for event in _changes(request, lambda: _look(kernel, actor, job_id, base_url), seen):
            yield event

    return StreamingResponse(
        events(),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _changes(request: Request, look: Any, seen: int | None) -> AsyncIterator[bytes]:
    """Give an event for each state that differs from the one seen last, and comments in between."""
    quiet_s = 0.0
    while not request.app.state.stopping.is_set():
        try:
            job, changed = await run_sync(look)
        except DatabaseBusy:
            job, changed = None, seen
        if job is not None and changed != seen:
            seen, quiet_s = changed, 0.0
            yield f"event: job\nid: {changed}\ndata: {job.model_dump_json()}\n\n".encode()
            if job.state.is_final:
                return
        elif quiet_s >= _KEEP_ALIVE_S:
            quiet_s = 0.0
            yield b": still here\n\n"
        await anyio.sleep(_LOOK_EVERY_S)
        quiet_s += _LOOK_EVERY_S


def _look(kernel: Kernel, actor: Actor, job_id: str, base_url: str) -> tuple[JobOut, int]:
    with kernel.db.reading() as session:
        row = jobs.covered_job(session, actor, job_id=job_id)
        return JobOut.of(row, base_url=base_url), row.changed
