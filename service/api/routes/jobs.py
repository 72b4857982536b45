"""Jobs: background work, its progress and its end."""

from __future__ import annotations

from collections.abc import AsyncIterator
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Header, Path, Query, Response
from starlette.concurrency import run_in_threadpool

from service.api.auth import TabletActor
from service.api.deps import BaseUrl, KernelDep, Once, answered, respond
from service.api.live import RETRY, BroadcastDep, EventStream, Listener, Message, Topic, job_message
from service.api.schemas.base import Page
from service.api.schemas.jobs import JobOut
from service.api.searching import SearchDep
from service.db.models import Job
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import JobKind, JobState
from service.usecases import jobs
from service.usecases.answer import Answered, answer_once
from service.usecases.find import find_jobs
from service.usecases.kernel import Kernel

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

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
    return JobOut.of(_look(kernel, actor, job_id), base_url=base_url)


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
async def listen_to_job(
    kernel: KernelDep,
    broadcast: BroadcastDep,
    actor: TabletActor,
    base_url: BaseUrl,
    job_id: JobId,
    last_event_id: Annotated[
        str | None, Header(description="`id` of the last event seen; a client that reconnects sends it.")
    ] = None,
) -> Response:
    """Listen to a job as server-sent events: its present state at once, then each change, until it ends.

    The stream ends after the event with a final state, and within five seconds of its key. After a
    reconnect with `Last-Event-ID` a state that was seen is not sent again, unless it is final.
    """
    with broadcast.joined(actor, Topic(job_id=job_id, base_url=base_url)) as listener:
        first = job_message(await run_in_threadpool(_look, kernel, actor, job_id), base_url=base_url)
    is_seen = last_event_id == first.mark and not first.is_last
    return EventStream(broadcast, listener, _frames(listener, first, is_seen=is_seen))


async def _frames(listener: Listener, first: Message, *, is_seen: bool) -> AsyncIterator[bytes]:
    yield RETRY
    if not is_seen:
        yield first.frame
    if first.is_last:
        return
    told = int(first.mark)
    async for message in listener.messages():
        if not message.mark:
            yield message.frame
        elif int(message.mark) > told:
            told = int(message.mark)
            yield message.frame
            if message.is_last:
                return


def _look(kernel: Kernel, actor: Actor, job_id: str) -> Job:
    with kernel.db.reading() as session:
        return jobs.covered_job(session, actor, job_id=job_id)
