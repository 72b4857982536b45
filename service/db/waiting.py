"""Jobs that are given back untried: to another worker, or until there is room on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.db.jobs import Attempt, held_job, present_at, requeue
from service.db.models import Job
from service.domain.lifecycle import JobState

_MOST_TOLD = 500


def wait_for_room(
    session: Session, attempt: Attempt, *, problem: dict[str, Any], wait_s: float, now: datetime
) -> None:
    """Give the job back, to be tried again in `wait_s` seconds; the try, which found no room, does not count.

    Until then the job shows the problem for which it waits.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    job = held_job(session, attempt)
    job.attempt -= 1
    job.problem = problem
    requeue(session, job, wait_s=wait_s, now=now)


def due_untold(session: Session, *, now: datetime) -> list[str]:
    """Return queued jobs that are due and show no problem for which they wait."""
    present = present_at(session, now)
    untold = Job.state == JobState.QUEUED.value, Job.run_after <= present, Job.problem.is_(None)
    return list(
        session.scalars(select(Job.id).where(*untold).order_by(Job.run_after, Job.id).limit(_MOST_TOLD))
    )


def tell_why_waiting(session: Session, job_ids: Sequence[str], *, problem: dict[str, Any]) -> None:
    """Let jobs that are still queued show the problem for which they wait; whoever claims them clears it."""
    waiting = Job.id.in_(job_ids), Job.state == JobState.QUEUED.value
    told = {"problem": problem, "changed": Job.changed + 1}
    session.execute(update(Job).where(*waiting).values(told).execution_options(synchronize_session=False))


def release(session: Session, attempt: Attempt, *, now: datetime) -> None:
    """Give the job back unfinished, for any worker to take at once; the try does not count.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    job = held_job(session, attempt)
    job.attempt -= 1
    requeue(session, job, wait_s=0.0, now=now)
