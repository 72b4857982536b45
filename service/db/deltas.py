"""Deltas between clouds: what one adds to another, made once and kept."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, ForeignKey, Select, UniqueConstraint, func, or_, select
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Artifact, Base, Channel, Id, Job, Revision, Sha256
from service.db.robots import Robot
from service.domain.lifecycle import JobKind, JobState

_LIVING = (JobState.QUEUED.value, JobState.RUNNING.value)


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
    return session.scalar(_holders(map_id, path=path, sha256=sha256).limit(1)) is not None


def is_wanted_cloud(session: Session, map_id: str, *, path: str, sha256: str, key_id: str) -> bool:
    """Return whether a robot is to have the file `path` with this SHA-256.

    That is so in a revision that a channel of the map points to, or that a roll-out gives the key's robot.
    """
    published = select(Channel.revision_n).where(Channel.map_id == map_id)
    given = select(Robot.assigned_n).where(
        Robot.key_id == key_id, Robot.map_id == map_id, Robot.assigned_n.is_not(None)
    )
    wanted = or_(Revision.n.in_(published), Revision.n.in_(given))
    query = _holders(map_id, path=path, sha256=sha256).where(wanted).limit(1)
    return session.scalar(query) is not None


def waiting_deltas(session: Session, map_id: str, *, foreseen: bool) -> int:
    """Return how many deltas of a map have still to be made: those that the product foresaw, or keys' own."""
    asker = Job.key_id.is_(None) if foreseen else Job.key_id.is_not(None)
    unmade = Job.map_id == map_id, Job.kind == JobKind.MAKE_DELTA.value, Job.state.in_(_LIVING)
    return session.scalar(select(func.count()).select_from(Job).where(*unmade, asker)) or 0


def _holders(map_id: str, *, path: str, sha256: str) -> Select[int]:
    """Return the query of a map's revisions that have this file."""
    return (
        select(Revision.n)
        .join(Artifact, Artifact.revision_id == Revision.id)
        .where(Revision.map_id == map_id, Artifact.path == path, Artifact.sha256 == sha256)
    )
