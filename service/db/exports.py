"""Exports: a revision's cloud in another format, made once, on request."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, CheckConstraint, ForeignKey, String, UniqueConstraint, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Id
from service.domain.lifecycle import ExportFormat

_FORMATS = f"format IN ({', '.join(repr(str(kind)) for kind in ExportFormat)})"


class Export(Base):
    """A revision's cloud in another format; `sha256` is null until its job has ended well."""

    __tablename__ = "exports"
    __table_args__ = (
        CheckConstraint(_FORMATS, name="format"),
        UniqueConstraint("revision_id", "format"),
        UniqueConstraint("job_id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    revision_id: Mapped[str] = mapped_column(ForeignKey("revisions.id"))
    format: Mapped[str] = mapped_column(String(8))
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    size_bytes: Mapped[int | None] = mapped_column(BigInteger)
    created_at: Mapped[datetime]


def find_export(session: Session, *, revision_id: str, kind: ExportFormat) -> Export | None:
    """Return the export of a revision in a format, asked for already, or None."""
    query = select(Export).where(Export.revision_id == revision_id, Export.format == kind.value)
    return session.scalars(query).one_or_none()
