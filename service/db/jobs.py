"""The record of background work: who may work on a job until when, and how it ended.

Every function runs inside the caller's transaction. An attempt holds its job by a token and a lease:
each write of an attempt names its token and changes nothing when another attempt has taken over, so
that a worker which wakes up late can spoil nothing.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, and_, func, or_, select, text, update
from sqlalchemy.orm import Session

from service.db.models import Job, Revision
from service.db.turns import due, in_turn, is_any_due
from service.db.webhooks import add_event
from service.domain.errors import JobCrashed, JobNotCancellable, JobNotRetryable
from service.domain.lifecycle import BACK_OFF_S, MAX_ATTEMPTS, JobKind, JobState, RevisionStatus
from service.domain.webhook import EventKind

QUEUE = "groundplan"
TASK = "groundplan.run_job"
_ON_ITS_WAY_S = 4.0


class LeaseLost(Exception):
    """The job is no longer this attempt's: taken over, ended, or cancelled; its result must not count."""


@dataclass(frozen=True)
class Attempt:
    """Hold one claim of a job: what is to be done, which try it is, and the token that proves it."""

    job_id: str
    kind: JobKind
    subject_id: str
    map_id: str
    attempt: int
    token: str


def enqueue(
    session: Session,
    kind: JobKind,
    *,
    job_id: str,
    map_id: str,
    subject_id: str,
    key_id: str | None,
    now: datetime,
) -> Job:
    """Return a new queued job; on PostgreSQL its delivery is deferred in the same transaction.

    Parameters
    ----------
    kind : JobKind
        What is to be done.
    job_id, map_id, subject_id : str
        Its id, the map that it belongs to, and the drawing, scan, placement or revision it works on.
    key_id : str or None
        Whose turn it takes: the key that asked for it; None is the product itself.
    now : datetime
        The present, with a time zone.
    """
    job = Job(
        id=job_id,
        kind=kind.value,
        map_id=map_id,
        subject_id=subject_id,
        key_id=key_id,
        state=JobState.QUEUED.value,
        attempt=0,
        run_after=present_at(session, now),
        cancel_requested=False,
        fraction=0.0,
        created_at=now,
        changed=0,
    )
    session.add(job)
    session.flush()
    deliver(session, job_id)
    return job


def deliver(session: Session, job_id: str, *, at: datetime | None = None) -> None:
    """Hand the job to procrastinate in the caller's transaction; does nothing on SQLite, which polls.

    A delivery says that there is a job to claim; which one, `claim` decides.
    """
    if session.get_bind().dialect.name != "postgresql":
        return
    session.execute(
        text(
            "SELECT procrastinate_defer_jobs_v1(ARRAY[ROW(:queue, :task, 0, NULL, NULL,"
            " CAST(:args AS jsonb), CAST(:at AS timestamptz))::procrastinate_job_to_defer_v1])"
        ),
        {"queue": QUEUE, "task": TASK, "args": json.dumps({"job_id": job_id}), "at": at},
    )


def claim(
    session: Session, *, worker: str, token: str, lease_s: float, now: datetime, job_id: str | None = None
) -> Attempt | None:
    """Return the job whose turn it is (`service.db.turns`), now held by `token`; None when nothing is due.

    Due is what is queued and past its back-off, and what runs under a lease that has expired: its
    worker is lost and this attempt takes over. A lost job whose attempts are used up, or whose cancel
    was asked for, is ended here instead.

    Parameters
    ----------
    worker : str
        Name of the worker, for people.
    token : str
        The new attempt's token, never used before.
    lease_s : float
        Seconds for which the job is held without a beat.
    job_id : str, optional
        Claim this job or none.
    """
    now = present_at(session, now)
    found = in_turn(session, now=now) if job_id is None else _due_by_id(session, job_id, now=now)
    for job in found:
        if job.state == JobState.RUNNING and not _survives_its_worker(session, job, now=now):
            continue
        job.state = JobState.RUNNING.value
        job.attempt += 1
        job.attempt_token, job.worker = token, worker
        job.lease_until = now + timedelta(seconds=lease_s)
        job.started_at = now
        job.stage, job.fraction, job.problem = None, 0.0, None
        job.changed += 1
        return Attempt(job.id, JobKind(job.kind), job.subject_id, job.map_id, job.attempt, token)
    return None


def _due_by_id(session: Session, job_id: str, *, now: datetime) -> Sequence[Job]:
    wanted = select(Job).where(due(now), Job.id == job_id)
    return session.scalars(wanted.with_for_update(skip_locked=True)).all()


def any_due(session: Session, *, now: datetime) -> bool:
    """Return whether `claim` would find a job."""
    return is_any_due(session, now=present_at(session, now))


def overdue(session: Session, *, now: datetime) -> list[str]:
    """Return jobs that have been due for seconds, oldest first: their delivery or their worker is lost.

    One that became due a moment ago is left to the delivery that is on its way.
    """
    present = present_at(session, now)
    lost = or_(
        and_(Job.state == JobState.QUEUED.value, Job.run_after <= present - timedelta(seconds=_ON_ITS_WAY_S)),
        and_(Job.state == JobState.RUNNING.value, Job.lease_until < present),
    )
    return list(session.scalars(select(Job.id).where(lost).order_by(Job.run_after, Job.id).limit(100)))


def running_tokens(session: Session) -> set[str]:
    """Return the tokens of all attempts that hold a job."""
    held = select(Job.attempt_token).where(Job.state == JobState.RUNNING.value)
    return {token for token in session.scalars(held) if token is not None}


def beat(
    session: Session,
    attempt: Attempt,
    *,
    lease_s: float,
    now: datetime,
    stage: str | None = None,
    fraction: float | None = None,
) -> bool:
    """Return whether a cancel is asked for; the lease runs `lease_s` from now, and progress is written.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    values: dict[str, Any] = {"lease_until": present_at(session, now) + timedelta(seconds=lease_s)}
    if stage is not None:
        values |= {"stage": stage[:80], "fraction": fraction or 0.0, "changed": Job.changed + 1}
    _guarded(session, attempt, values)
    return bool(session.scalar(select(Job.cancel_requested).where(Job.id == attempt.job_id)))


def has_succeeded(session: Session, attempt: Attempt) -> bool:
    """Return whether this very attempt has recorded its result."""
    job = session.get_one(Job, attempt.job_id)
    return job.state == JobState.SUCCEEDED and job.attempt_token == attempt.token


def finish_succeeded(session: Session, attempt: Attempt, *, now: datetime) -> None:
    """End the job well; belongs into the transaction that writes its result.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: the whole transaction has to be given up.
    """
    values = {"state": JobState.SUCCEEDED.value, "stage": None, "fraction": 1.0, "ended_at": now}
    _guarded(session, attempt, values | {"lease_until": None, "changed": Job.changed + 1})


def finish_failed(session: Session, attempt: Attempt, *, problem: dict[str, Any], now: datetime) -> None:
    """End the job for good with a problem; a revision that it was building fails with it.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    _end(session, held_job(session, attempt), JobState.FAILED, problem=problem, now=now)


def finish_cancelled(session: Session, attempt: Attempt, *, now: datetime) -> None:
    """End the job because a cancel was asked for; a revision that it was building fails.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    _end(session, held_job(session, attempt), JobState.CANCELLED, problem=None, now=now)


def try_again(session: Session, attempt: Attempt, *, problem: dict[str, Any], now: datetime) -> bool:
    """Return whether the job will be tried again after its back-off; else it has failed with `problem`.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    job = held_job(session, attempt)
    if job.attempt >= MAX_ATTEMPTS:
        _end(session, job, JobState.FAILED, problem=problem, now=now)
        return False
    requeue(session, job, wait_s=BACK_OFF_S[job.attempt - 1], now=now)
    return True


def crashed(*, attempts: int, last: str) -> JobCrashed:
    """Return the refusal of a job that a defect ended, or whose process died `attempts` times."""
    times = "once" if attempts == 1 else f"{attempts} times"
    detail = (
        f"The job was tried {times} and did not come to its end; the last time: {last}. Nothing was changed. "
        "Retry it once; if it ends so again, the worker's log tells the cause under the job's id."
    )
    return JobCrashed(detail, attempts=attempts, last=last)


def request_cancel(session: Session, job_id: str, *, now: datetime) -> Job:
    """Return the job, cancelled when it was queued, else marked so that its worker stops it within a beat.

    Raises
    ------
    JobNotCancellable
        If the job has already ended.
    """
    job = session.scalars(select(Job).where(Job.id == job_id).with_for_update()).one()
    if JobState(job.state).is_final:
        raise JobNotCancellable(f"The job has already ended: it is {job.state}.", state=job.state)
    if job.state == JobState.QUEUED:
        _end(session, job, JobState.CANCELLED, problem=None, now=now)
    elif not job.cancel_requested:
        job.cancel_requested = True
        job.changed += 1
    return job


def retry(session: Session, job_id: str, *, now: datetime) -> Job:
    """Return the job, queued anew with all its attempts.

    Raises
    ------
    JobNotRetryable
        If the job has not failed or been cancelled, or was building a revision: a failed revision
        stays failed, and a new one is asked for instead.
    """
    job = session.scalars(select(Job).where(Job.id == job_id).with_for_update()).one()
    if job.state not in {JobState.FAILED, JobState.CANCELLED}:
        raise JobNotRetryable(f"Only an ended job can be tried again; this one is {job.state}.")
    if job.kind == JobKind.BUILD_REVISION:
        raise JobNotRetryable("A revision that failed stays failed: ask for a new revision instead.")
    job.attempt, job.full_tries, job.cancel_requested = 0, 0, False
    job.problem = job.ended_at = None
    requeue(session, job, wait_s=0.0, now=now)
    return job


def present_at(session: Session, now: datetime) -> datetime:
    """Return PostgreSQL's own clock, which all machines share; on SQLite, one machine, the given one."""
    if session.get_bind().dialect.name != "postgresql":
        return now
    present: datetime = session.execute(select(func.clock_timestamp())).scalar_one()
    return present


def _survives_its_worker(session: Session, job: Job, *, now: datetime) -> bool:
    """Return whether a job whose worker is lost may be tried again; if not, it is ended here."""
    if job.cancel_requested:
        _end(session, job, JobState.CANCELLED, problem=None, now=now)
        return False
    if job.attempt >= MAX_ATTEMPTS:
        problem = crashed(attempts=job.attempt, last="its worker stopped answering").problem()
        _end(session, job, JobState.FAILED, problem=problem, now=now)
        return False
    return True


def _mine(attempt: Attempt) -> ColumnElement[bool]:
    return and_(
        Job.id == attempt.job_id,
        Job.state == JobState.RUNNING.value,
        Job.attempt_token == attempt.token,
    )


def _be_brief(session: Session) -> None:
    """Let PostgreSQL give up on this transaction soon: a process that is stopped within it holds the row.

    SQLite has one lock for all; a worker that is stopped while it holds it is waited for.
    """
    if session.get_bind().dialect.name == "postgresql":
        session.execute(text("SET LOCAL lock_timeout = '5s'"))
        session.execute(text("SET LOCAL idle_in_transaction_session_timeout = '10s'"))


def _guarded(session: Session, attempt: Attempt, values: dict[str, Any]) -> None:
    _be_brief(session)
    held = session.scalar(
        update(Job)
        .where(_mine(attempt))
        .values(values)
        .returning(Job.id)
        .execution_options(synchronize_session=False)
    )
    if held is None:
        raise LeaseLost(attempt.job_id)


def held_job(session: Session, attempt: Attempt) -> Job:
    """Return the job that an attempt holds, locked.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    _be_brief(session)
    job = session.scalars(select(Job).where(_mine(attempt)).with_for_update()).one_or_none()
    if job is None:
        raise LeaseLost(attempt.job_id)
    return job


def requeue(session: Session, job: Job, *, wait_s: float, now: datetime) -> None:
    """Put a job back into the queue, due in `wait_s` seconds."""
    present = present_at(session, now)
    job.state = JobState.QUEUED.value
    job.run_after = present + timedelta(seconds=wait_s)
    job.attempt_token = job.worker = job.lease_until = job.stage = None
    job.fraction = 0.0
    job.changed += 1
    deliver(session, job.id, at=job.run_after if wait_s else None)


def _end(
    session: Session, job: Job, state: JobState, *, problem: dict[str, Any] | None, now: datetime
) -> None:
    job.state, job.problem, job.ended_at = state.value, problem, now
    job.lease_until = job.stage = None
    job.changed += 1
    if state is JobState.FAILED:
        _tell_failed(session, job, now=now)
    if job.kind == JobKind.BUILD_REVISION:
        session.execute(
            update(Revision)
            .where(Revision.job_id == job.id, Revision.status == RevisionStatus.BUILDING.value)
            .values(status=RevisionStatus.FAILED.value, ended_at=now)
        )


def _tell_failed(session: Session, job: Job, *, now: datetime) -> None:
    """Write down that a job failed, for the webhooks; of their own jobs they are told nothing."""
    if job.kind == JobKind.DELIVER_WEBHOOKS:
        return
    event_id = f"evt_{job.id.rpartition('_')[2]}-{job.changed}"
    told = {"job_id": job.id, "kind": job.kind, "subject_id": job.subject_id, "problem": job.problem}
    add_event(session, EventKind.JOB_FAILED, event_id=event_id, map_id=job.map_id, told=told, at=now)
