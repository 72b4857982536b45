"""Figures of the whole service."""

from __future__ import annotations

from datetime import datetime
from typing import Self

from pydantic import Field

from service.api.schemas.base import Output
from service.domain.lifecycle import RevisionStatus
from service.usecases.stats import Stats


class LatestRevision(Output):
    """A revision in short."""

    map_id: str
    n: int
    status: RevisionStatus
    created_at: datetime
    ended_at: datetime | None


class StatsOut(Output):
    """What is going on, in numbers."""

    totals: dict[str, int] = Field(description="How many maps, drawings, scans and revisions there are.")
    jobs: dict[str, int] = Field(description="How many jobs are in each state.")
    queue_age_s: float = Field(description="For how long the oldest job that is due has waited.")
    latest_revisions: list[LatestRevision]
    stored_bytes: int = Field(description="Bytes of all files that are in use, each counted once.")
    free_bytes: int = Field(description="Bytes for which the disk has room.")
    is_storage_full: bool = Field(
        description="Whether so little is free that uploads and jobs are refused with `storage-full`."
    )

    @classmethod
    def of(cls, found: Stats) -> Self:
        """Return the figures as JSON."""
        return cls(
            totals=found.totals,
            jobs=found.jobs.by_state,
            queue_age_s=found.jobs.queue_age_s,
            latest_revisions=[LatestRevision.model_validate(row) for row in found.latest_revisions],
            stored_bytes=found.stored_bytes,
            free_bytes=found.free_bytes,
            is_storage_full=found.is_storage_full,
        )


class SeriesPoint(Output):
    """How many things of one state were made in the hour or day that begins at `at`."""

    at: datetime
    state: str | None
    number: int


class SeriesOut(Output):
    """Counts over a period, oldest first; hours and days in which nothing was made are left out."""

    what: str
    bucket: str
    points: list[SeriesPoint]


class HealthOut(Output):
    """The process is alive."""

    status: str = "ok"


class ReadyOut(Output):
    """The service answers; `checks` names what was looked at.

    Each is `ok`; `storage` begins with `storage-full` while uploads and jobs wait for room.
    """

    status: str = "ok"
    checks: dict[str, str]
