"""What is going on, in numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from service.db import stats as table
from service.db.models import Revision
from service.db.revisions import latest_revisions
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.kernel import Kernel

_LATEST = 10


@dataclass(frozen=True)
class JobFigures:
    """Hold how many jobs are in each state, and for how long the oldest due one has waited [s]."""

    by_state: dict[str, int]
    queue_age_s: float


@dataclass(frozen=True)
class Stats:
    """Hold counts of things, figures of jobs, the latest revisions, and the room on disk [bytes]."""

    totals: dict[str, int]
    jobs: JobFigures
    latest_revisions: Sequence[Revision]
    stored_bytes: int
    free_bytes: int


def job_figures(kernel: Kernel) -> JobFigures:
    """Return how the jobs stand, in a transaction of its own."""
    with kernel.db.reading() as session:
        return _job_figures(kernel, session)


def stats(kernel: Kernel, session: Session, actor: Actor) -> Stats:
    """Return the whole service's figures.

    Raises
    ------
    Forbidden
        If `actor` is no admin of all maps.
    """
    actor.require_role(Role.ADMIN)
    actor.require_all_maps()
    return Stats(
        totals=table.totals(session),
        jobs=_job_figures(kernel, session),
        latest_revisions=latest_revisions(session, limit=_LATEST),
        stored_bytes=table.blob_bytes(session),
        free_bytes=kernel.blobs.free_bytes(),
    )


def _job_figures(kernel: Kernel, session: Session) -> JobFigures:
    now = kernel.now()
    since = table.oldest_due(session, now=now)
    return JobFigures(
        table.jobs_by_state(session), 0.0 if since is None else max(0.0, (now - since).total_seconds())
    )
