"""Jobs as people look at them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Job
from service.domain.lifecycle import JobKind, JobState


def find_job(session: Session, job_id: str) -> Job | None:
    """Return the job with this id, or None."""
    return session.get(Job, job_id)


def list_jobs(
    session: Session,
    *,
    covered: Collection[str] | None,
    state: JobState | None,
    kind: JobKind | None,
    map_id: str | None,
    before: str | None,
    limit: int,
) -> Sequence[Job]:
    """Return up to `limit` jobs, newest first, with ids before `before`.

    Parameters
    ----------
    covered : collection of str, optional
        Only jobs of these maps; None means all.
    """
    query = select(Job).order_by(Job.id.desc()).limit(limit)
    if covered is not None:
        query = query.where(Job.map_id.in_(covered))
    if state is not None:
        query = query.where(Job.state == state.value)
    if kind is not None:
        query = query.where(Job.kind == kind.value)
    if map_id is not None:
        query = query.where(Job.map_id == map_id)
    if before is not None:
        query = query.where(Job.id < before)
    return session.scalars(query).all()
