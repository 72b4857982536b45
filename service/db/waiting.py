"""Jobs that are given back untried: to another worker, or until there is room on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.db.jobs import Attempt, finish_failed, held_job, present_at, requeue
from service.db.models import Job
from service.domain.lifecycle import MOST_FULL_TRIES, JobState

_MOST_TOLD = 500


def give_back(
    session: Session,
    attempt: Attempt,
    *,
    now: datetime,
    problem: dict[str, Any] | None = None,
    wait_s: float = 0.0,
) -> None:
    """Give the job back unfinished, for any worker to take in `wait_s` seconds; the try does not count.

    Until then the job shows the `problem` for which it waits, if there is one.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    job = held_job(session, attempt)
    job.attempt -= 1
    job.problem = problem
    requeue(session, job, wait_s=wait_s, now=now)


def wait_for_room(
    session: Session,
    attempt: Attempt,
    *,
    problem: dict[str, Any],
    last: dict[str, Any],
    wait_s: float,
    now: datetime,
) -> bool:
    """Return whether the job, which began with room and found the disk full, waits as `give_back` has it.

    If it has found it so for the last time, it has failed with `last`: it does not fit.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's.
    """
    job = held_job(session, attempt)
    job.full_tries += 1
    if job.full_tries >= MOST_FULL_TRIES:
        finish_failed(session, attempt, problem=last, now=now)
        return False
    give_back(session, attempt, problem=problem, wait_s=wait_s, now=now)
    return True


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
