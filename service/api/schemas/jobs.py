"""Jobs as they are shown."""

from __future__ import annotations

from datetime import datetime
from typing import Self

from pydantic import Field

from service.api.problems import document
from service.api.schemas.base import Output, Problem
from service.db.models import Job
from service.domain.lifecycle import JobKind, JobState


class JobOut(Output):
    """Background work. `succeeded`, `failed` and `cancelled` are final."""

    id: str
    kind: JobKind
    map_id: str
    subject_id: str = Field(description="The drawing, scan, placement or revision that it works on.")
    state: JobState
    stage: str | None = Field(description="What it is doing, while it runs.")
    fraction: float = Field(ge=0, le=1, description="How far it is.")
    attempt: int = Field(description="Which try this is; 0 before the first.")
    cancel_requested: bool
    problem: Problem | None = Field(
        description="Why it failed; or, of a queued job, what it waits for: a problem document."
    )
    created_at: datetime
    started_at: datetime | None
    ended_at: datetime | None

    @classmethod
    def of(cls, row: Job, *, base_url: str) -> Self:
        """Return a job as JSON; `base_url` completes its problem's type."""
        problem = None if row.problem is None else document(row.problem, base_url=base_url)
        fields = {name: getattr(row, name) for name in cls.model_fields if name != "problem"}
        return cls(**fields, problem=None if problem is None else Problem(**problem))
