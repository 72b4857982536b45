"""Entries of the audit log, as they are shown."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from service.api.schemas.base import JsonObject, Output


class AuditEntryOut(Output):
    """One change: who made it, to what, and what it was before and after."""

    id: str
    at: datetime
    key_id: str | None = Field(description="The key that asked for it; null is the server's own console.")
    action: str
    map_id: str | None
    subject_id: str
    before: JsonObject | None
    after: JsonObject | None
