"""Deltas between clouds: what one adds to another, made once and kept."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, ForeignKey, UniqueConstraint, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Artifact, Base, Id, Revision, Sha256


class Delta(Base):
    """What one cloud adds to another; its own bytes are null until its job has ended well."""

    __tablename__ = "deltas"
    __table_args__ = (UniqueConstraint("from_sha256", "to_sha256"), UniqueConstraint("job_id"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    from_sha256: Mapped[str] = mapped_column(Sha256)
    to_sha256: Mapped[str] = mapped_column(Sha256)
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    size_bytes: Mapped[int | None] = mapped_column(BigInteger)
    coded_sha256: Mapped[str | None] = mapped_column(Sha256)
    created_at: Mapped[datetime]


def find_delta(session: Session, *, from_sha256: str, to_sha256: str) -> Delta | None:
    """Return the delta between two clouds, made or being made, or None when nobody asked for it yet."""
    wanted = select(Delta).where(Delta.from_sha256 == from_sha256, Delta.to_sha256 == to_sha256)
    return session.scalars(wanted).one_or_none()


def is_cloud_of(session: Session, map_id: str, *, path: str, sha256: str) -> bool:
    """Return whether some revision of the map has the file `path` with this SHA-256."""
    wanted = (
        select(Revision.n)
        .join(Artifact, Artifact.revision_id == Revision.id)
        .where(Revision.map_id == map_id, Artifact.path == path, Artifact.sha256 == sha256)
        .limit(1)
    )
    return session.scalar(wanted) is not None
