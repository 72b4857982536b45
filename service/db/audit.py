"""The audit log: who changed what, when, from what to what; rows are added and never changed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index, String, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Id


class AuditEntry(Base):
    """One change; `key_id` null is the product itself, `map_id` null what belongs to no map."""

    __tablename__ = "audit"
    __table_args__ = (
        Index(None, "map_id", "id"),
        Index(None, "map_id", "action", "id"),
        Index(None, "key_id", "id"),
        Index(None, "action", "id"),
        Index(None, "subject_id", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    at: Mapped[datetime]
    key_id: Mapped[str | None] = mapped_column(ForeignKey("keys.id"))
    action: Mapped[str] = mapped_column(String(40))
    map_id: Mapped[str | None] = mapped_column(ForeignKey("maps.id"))
    subject_id: Mapped[str] = mapped_column(Id)
    before: Mapped[dict[str, Any] | None]
    after: Mapped[dict[str, Any] | None]


@dataclass(frozen=True)
class AuditFilter:
    """Hold what entries are asked for; None asks for all.

    Parameters
    ----------
    covered : collection of str, optional
        Only entries of these maps.
    since, until : datetime, optional
        Only entries from `since` on and before `until`.
    """

    covered: Collection[str] | None = None
    map_id: str | None = None
    key_id: str | None = None
    action: str | None = None
    subject_id: str | None = None
    since: datetime | None = None
    until: datetime | None = None


def add_entry(session: Session, entry: AuditEntry) -> None:
    """Add one entry, in the transaction of the change that it tells of."""
    session.add(entry)


def list_entries(
    session: Session, wanted: AuditFilter, *, before: str | None, limit: int
) -> Sequence[AuditEntry]:
    """Return up to `limit` entries, newest first, with ids before `before`."""
    query = select(AuditEntry).order_by(AuditEntry.id.desc()).limit(limit)
    if wanted.covered is not None:
        query = query.where(AuditEntry.map_id.in_(wanted.covered))
    for name in ("map_id", "key_id", "action", "subject_id"):
        value = getattr(wanted, name)
        if value is not None:
            query = query.where(getattr(AuditEntry, name) == value)
    if wanted.since is not None:
        query = query.where(AuditEntry.at >= wanted.since)
    if wanted.until is not None:
        query = query.where(AuditEntry.at < wanted.until)
    if before is not None:
        query = query.where(AuditEntry.id < before)
    return session.scalars(query).all()
