"""Counts over all tables."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.db.models import Blob, Drawing, Job, Map, Scan
from service.domain.lifecycle import JobState


def jobs_by_state(session: Session) -> dict[str, int]:
    """Return how many jobs are in each state, those with none included.

    Most jobs of a plant's years have succeeded: these are what the others leave of all, and are not counted.
    """
    others = [state.value for state in JobState if state is not JobState.SUCCEEDED]
    all_jobs = select(func.count()).select_from(Job)
    asked = [all_jobs.where(Job.state == state).scalar_subquery() for state in others]
    total, *numbers = session.execute(select(all_jobs.scalar_subquery(), *asked)).one()
    return {JobState.SUCCEEDED.value: total - sum(numbers)} | dict(zip(others, numbers, strict=True))


def oldest_due(session: Session, *, now: datetime) -> datetime | None:
    """Return since when the oldest queued job could have been started, or None when none waits."""
    return session.scalars(
        select(Job.run_after)
        .where(Job.state == JobState.QUEUED.value, Job.run_after <= now)
        .order_by(Job.run_after)
        .limit(1)
    ).one_or_none()


def totals(session: Session) -> dict[str, int]:
    """Return how many maps, drawings, scans and revisions there are.

    Each map knows the number of its next revision, and no revision's row ever goes: they need no counting.
    """
    tables = {"maps": Map, "drawings": Drawing, "scans": Scan}
    asked = {name: select(func.count()).select_from(table) for name, table in tables.items()}
    asked["revisions"] = select(func.coalesce(func.sum(Map.next_revision - 1), 0))
    row = session.execute(select(*(query.scalar_subquery() for query in asked.values()))).one()
    return dict(zip(asked, (int(number) for number in row), strict=True))


def blob_bytes(session: Session) -> int:
    """Return the bytes of all files that rows refer to, each counted once."""
    return int(session.scalar(select(func.sum(Blob.size_bytes))) or 0)
