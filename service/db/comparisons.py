"""Comparisons of two revisions' geometry: made once by a job, and kept."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, UniqueConstraint, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Id


class Comparison(Base):
    """What lies in one revision's cloud and not in another's; `geometry` is null until its job has ended."""

    __tablename__ = "comparisons"
    __table_args__ = (UniqueConstraint("from_revision_id", "to_revision_id"), UniqueConstraint("job_id"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    from_revision_id: Mapped[str] = mapped_column(ForeignKey("revisions.id"))
    to_revision_id: Mapped[str] = mapped_column(ForeignKey("revisions.id"))
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    geometry: Mapped[dict[str, Any] | None]
    picture_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    created_at: Mapped[datetime]


def find_comparison(session: Session, *, from_id: str, to_id: str) -> Comparison | None:
    """Return the comparison of two revisions, made or being made, or None when nobody asked for it yet."""
    wanted = select(Comparison).where(
        Comparison.from_revision_id == from_id, Comparison.to_revision_id == to_id
    )
    return session.scalars(wanted).one_or_none()
