"""Exports as JSON."""

from __future__ import annotations

from datetime import datetime
from typing import Self

from pydantic import Field

from service.api.schemas.base import Input, Output
from service.api.schemas.jobs import JobOut
from service.domain.lifecycle import ExportFormat
from service.usecases.exports import Asked


class ExportIn(Input):
    """What a revision's cloud is to be exported as."""

    format: ExportFormat


class ExportOut(Output):
    """An export: a revision's cloud in another format."""

    id: str
    format: ExportFormat
    url: str = Field(description="Where it can be fetched, once its job has succeeded.")
    sha256: str | None = Field(description="SHA-256 of the file; null until it is made.")
    size_bytes: int | None
    created_at: datetime


class AskedExportOut(Output):
    """An export with the job that makes or made it."""

    export: ExportOut
    job: JobOut

    @classmethod
    def of(cls, asked: Asked, *, map_id: str, n: int, base_url: str) -> Self:
        """Return an export as JSON."""
        row = asked.export
        shown = ExportOut(
            id=row.id,
            format=ExportFormat(row.format),
            url=f"{base_url}/v1/maps/{map_id}/revisions/{n}/exports/{row.format}",
            sha256=row.sha256,
            size_bytes=row.size_bytes,
            created_at=row.created_at,
        )
        return cls(export=shown, job=JobOut.of(asked.job, base_url=base_url))
