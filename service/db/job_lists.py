"""Jobs as people look at them."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Job
from service.db.narrowing import Narrowing, narrowed


def find_job(session: Session, job_id: str) -> Job | None:
    """Return the job with this id, or None."""
    return session.get(Job, job_id)


def list_jobs(session: Session, wanted: Narrowing) -> Sequence[Job]:
    """Return jobs, narrowed by `state`, `kind` and `map_id`."""
    return session.scalars(narrowed(select(Job), Job, wanted, prefix="job")).all()
