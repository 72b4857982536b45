"""Jobs as people look at them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Job
from service.db.narrowing import Narrowing, narrowed

_BATCH = 500


def find_job(session: Session, job_id: str) -> Job | None:
    """Return the job with this id, or None."""
    return session.get(Job, job_id)


def find_changed(session: Session, seen: Mapping[str, int]) -> list[Job]:
    """Return those of the jobs that have changed since their counter stood as it was `seen`."""
    wanted, changed = sorted(seen), list[Job]()
    for begin in range(0, len(wanted), _BATCH):
        part = wanted[begin : begin + _BATCH]
        counters = session.execute(select(Job.id, Job.changed).where(Job.id.in_(part)))
        moved = [job_id for job_id, counter in counters if counter != seen[job_id]]
        changed += session.scalars(select(Job).where(Job.id.in_(moved))) if moved else []
    return changed


def list_jobs(session: Session, wanted: Narrowing) -> Sequence[Job]:
    """Return jobs, narrowed by `state`, `kind` and `map_id`."""
    return session.scalars(narrowed(select(Job), Job, wanted, prefix="job")).all()
