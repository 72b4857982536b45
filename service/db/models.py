"""Tables of the product; every name, constraint and index is stable, since migrations match on them."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    BigInteger,
    CheckConstraint,
    DateTime,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Text,
    UniqueConstraint,
    true,
)
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column
from sqlalchemy.types import TypeDecorator

from service.domain.lifecycle import JobState, RevisionStatus, Role


class Moment(TypeDecorator[datetime]):
    """Store an instant in UTC on both databases, and give it back with its time zone."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Return the instant as the database takes it: UTC, naive on SQLite."""
        if value is None:
            return None
        if value.tzinfo is None:
            msg = "an instant needs a time zone"
            raise ValueError(msg)
        utc = value.astimezone(UTC)
        return utc.replace(tzinfo=None) if dialect.name == "sqlite" else utc

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:  # noqa: ARG002 - the interface
        """Return the instant in UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


Json = JSON().with_variant(JSONB(), "postgresql")
Id = String(40)
Sha256 = String(64)
Name = String(200)


def _one_of(column: str, values: type[JobState | RevisionStatus | Role]) -> str:
    return f"{column} IN ({', '.join(repr(str(v)) for v in values)})"


class Base(DeclarativeBase):
    """Hold the naming of constraints for every table."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "ck": "ck_%(table_name)s_%(constraint_name)s",
            "fk": "fk_%(table_name)s_%(column_0_N_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {datetime: Moment(), dict[str, Any]: Json, list[Any]: Json}  # noqa: RUF012 - SQLAlchemy's form


class Key(Base):
    """An API key: only its SHA-256 is kept; `map_ids` null covers all maps."""

    __tablename__ = "keys"
    __table_args__ = (CheckConstraint(_one_of("role", Role), name="role"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(Name)
    role: Mapped[str] = mapped_column(String(16))
    digest: Mapped[str] = mapped_column(Sha256, unique=True)
    map_ids: Mapped[list[Any] | None] = mapped_column(Json)
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]


class Map(Base):
    """One floor of one site: the identity that lasts."""

    __tablename__ = "maps"
    __table_args__ = (UniqueConstraint("site", "name"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    site: Mapped[str] = mapped_column(Name)
    name: Mapped[str] = mapped_column(Name)
    created_at: Mapped[datetime]
    updated_at: Mapped[datetime]
    next_revision: Mapped[int] = mapped_column(default=1)


class Blob(Base):
    """Bytes that rows refer to, named by their SHA-256; a stored blob without a row is an orphan."""

    __tablename__ = "blobs"

    sha256: Mapped[str] = mapped_column(Sha256, primary_key=True)
    size_bytes: Mapped[int] = mapped_column(BigInteger)
    media_type: Mapped[str] = mapped_column(String(100))
    created_at: Mapped[datetime]


class Drawing(Base):
    """An uploaded drawing; `reading` and its files are null until its job has ended well."""

    __tablename__ = "drawings"
    __table_args__ = (Index(None, "map_id", "id"), Index(None, "created_by", "id"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    file_name: Mapped[str] = mapped_column(String(255))
    blob_sha256: Mapped[str] = mapped_column(ForeignKey("blobs.sha256"))
    options: Mapped[dict[str, Any]]
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    reading: Mapped[dict[str, Any] | None]
    walls_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    removed_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    sheet_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    tiles_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    preview_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))


class Scan(Base):
    """An uploaded tablet scan; `reading` and its files are null until its job has ended well."""

    __tablename__ = "scans"
    __table_args__ = (Index(None, "map_id", "id"), Index(None, "created_by", "id"))

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    file_name: Mapped[str] = mapped_column(String(255))
    blob_sha256: Mapped[str] = mapped_column(ForeignKey("blobs.sha256"))
    rough_pose: Mapped[dict[str, Any] | None]
    options: Mapped[dict[str, Any] | None]
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    reading: Mapped[dict[str, Any] | None]
    points_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    upright_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    preview_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))


class Placement(Base):
    """One attempt to place a scan on a revision; `verdict` is null until its job has ended well."""

    __tablename__ = "placements"
    __table_args__ = (
        UniqueConstraint("job_id"),
        Index(None, "scan_id", "id"),
        Index(None, "map_id", "id"),
        Index(None, "verdict", "id"),
        Index(None, "created_by", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    scan_id: Mapped[str] = mapped_column(ForeignKey("scans.id"))
    revision_n: Mapped[int]
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    initial_pose: Mapped[dict[str, Any] | None]
    ndt_resolution_m: Mapped[float]
    T_map_scan: Mapped[list[Any] | None] = mapped_column("t_map_scan", Json)
    verdict: Mapped[str | None] = mapped_column(String(16))
    reasons: Mapped[list[Any] | None] = mapped_column(Json)
    evidence: Mapped[dict[str, Any] | None]
    candidates: Mapped[list[Any] | None] = mapped_column(Json)
    labels_sha256: Mapped[str | None] = mapped_column(ForeignKey("blobs.sha256"))
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))


class Revision(Base):
    """An immutable numbered state of a map: a recipe, a drawing's reading, ordered layers, erased regions.

    The reading is held by its walls, its scale and where its frame lies in the file: a drawing that is read
    anew changes no revision. `parent_n` is what the operations were applied to, `base_n` what the person who
    asked had before the eyes. `artifacts_sha256` is the digest of all files together; `pruned_at` tells when
    they were let go.
    """

    __tablename__ = "revisions"
    __table_args__ = (
        UniqueConstraint("map_id", "n"),
        UniqueConstraint("job_id"),
        CheckConstraint(_one_of("status", RevisionStatus), name="status"),
        Index(None, "map_id", "status", "n"),
        Index(None, "map_id", "id"),
        Index(None, "status", "id"),
        Index(None, "created_by", "id"),
        Index(None, "drawing_id", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    n: Mapped[int]
    parent_n: Mapped[int | None]
    status: Mapped[str] = mapped_column(String(16))
    recipe: Mapped[dict[str, Any]]
    drawing_id: Mapped[str] = mapped_column(ForeignKey("drawings.id"))
    walls_sha256: Mapped[str] = mapped_column(ForeignKey("blobs.sha256"))
    scale: Mapped[dict[str, Any]]
    job_id: Mapped[str] = mapped_column(ForeignKey("jobs.id"))
    report: Mapped[dict[str, Any] | None]
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))
    ended_at: Mapped[datetime | None]
    base_n: Mapped[int | None]
    operations: Mapped[list[Any] | None] = mapped_column(Json)
    erased: Mapped[list[Any] | None] = mapped_column(Json)
    reason: Mapped[str | None] = mapped_column(Text)
    software_version: Mapped[str | None] = mapped_column(String(40))
    artifacts_sha256: Mapped[str | None] = mapped_column(Sha256)
    pruned_at: Mapped[datetime | None]
    drawing_frame: Mapped[dict[str, Any] | None]


class Layer(Base):
    """A placed scan in a revision, in the order in which it is compounded; `part` null is all of it.

    `layer_id` stays the same from revision to revision; `T_map_scan` null is where the placement has it.
    `accepted_by` is the key that took the placement into the map, whoever made this revision.
    """

    __tablename__ = "layers"
    __table_args__ = (
        UniqueConstraint("revision_id", "position"),
        UniqueConstraint("revision_id", "layer_id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    layer_id: Mapped[str] = mapped_column(Id)
    revision_id: Mapped[str] = mapped_column(ForeignKey("revisions.id"))
    position: Mapped[int]
    name: Mapped[str] = mapped_column(Name)
    scan_id: Mapped[str] = mapped_column(ForeignKey("scans.id"))
    placement_id: Mapped[str] = mapped_column(ForeignKey("placements.id"))
    part: Mapped[dict[str, Any] | None]
    visible: Mapped[bool] = mapped_column(default=True, server_default=true())
    T_map_scan: Mapped[list[Any] | None] = mapped_column("t_map_scan", Json)
    accepted_by: Mapped[str | None] = mapped_column(ForeignKey("keys.id"))
    accepted_at: Mapped[datetime | None]


class Artifact(Base):
    """A file derived for a ready revision."""

    __tablename__ = "artifacts"

    revision_id: Mapped[str] = mapped_column(ForeignKey("revisions.id"), primary_key=True)
    path: Mapped[str] = mapped_column(String(255), primary_key=True)
    sha256: Mapped[str] = mapped_column(ForeignKey("blobs.sha256"))
    size_bytes: Mapped[int] = mapped_column(BigInteger)
    media_type: Mapped[str] = mapped_column(String(100))


class Channel(Base):
    """Which revision of a map is published on a channel; `generation` counts the moves of the pointer."""

    __tablename__ = "channels"

    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"), primary_key=True)
    name: Mapped[str] = mapped_column(String(40), primary_key=True)
    revision_n: Mapped[int]
    generation: Mapped[int]
    published_at: Mapped[datetime]


class Publication(Base):
    """One move of a channel's pointer: who, when, from, to, why, and which gates an admin overrode."""

    __tablename__ = "publications"
    __table_args__ = (UniqueConstraint("map_id", "channel", "generation"),)

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    channel: Mapped[str] = mapped_column(String(40))
    generation: Mapped[int]
    from_n: Mapped[int | None]
    to_n: Mapped[int]
    published_at: Mapped[datetime]
    published_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))
    reason: Mapped[str | None] = mapped_column(Text)
    overridden: Mapped[list[Any] | None] = mapped_column(Json)


class Job(Base):
    """Background work: the record of its state, whatever delivers it.

    `key_id` is the key that asked for it; null is the product itself. `full_tries` counts the attempts that
    began with room on the disk and found it full; they are no part of `attempt`.
    """

    __tablename__ = "jobs"
    __table_args__ = (
        CheckConstraint(_one_of("state", JobState), name="state"),
        Index(None, "state", "run_after", "id"),
        Index(None, "map_id", "id"),
        Index(None, "state", "id"),
        Index(None, "kind", "id"),
        Index(None, "map_id", "state", "id"),
        Index(None, "kind", "state", "id"),
        Index(None, "subject_id"),
        Index(None, "started_at"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    kind: Mapped[str] = mapped_column(String(40))
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    subject_id: Mapped[str] = mapped_column(Id)
    key_id: Mapped[str | None] = mapped_column(ForeignKey("keys.id"))
    state: Mapped[str] = mapped_column(String(16))
    attempt: Mapped[int] = mapped_column(default=0)
    full_tries: Mapped[int] = mapped_column(default=0, server_default="0")
    attempt_token: Mapped[str | None] = mapped_column(Id)
    worker: Mapped[str | None] = mapped_column(String(200))
    lease_until: Mapped[datetime | None]
    run_after: Mapped[datetime]
    cancel_requested: Mapped[bool] = mapped_column(default=False)
    stage: Mapped[str | None] = mapped_column(String(80))
    fraction: Mapped[float] = mapped_column(default=0.0)
    problem: Mapped[dict[str, Any] | None]
    created_at: Mapped[datetime]
    started_at: Mapped[datetime | None]
    ended_at: Mapped[datetime | None]
    changed: Mapped[int] = mapped_column(Integer, default=0)


class Answer(Base):
    """What a POST with an Idempotency-Key was answered, kept in the transaction of its effect."""

    __tablename__ = "answers"

    key_id: Mapped[str] = mapped_column(ForeignKey("keys.id"), primary_key=True)
    idempotency_key: Mapped[str] = mapped_column(String(255), primary_key=True)
    request_sha256: Mapped[str] = mapped_column(Sha256)
    status: Mapped[int]
    headers: Mapped[dict[str, Any]]
    body: Mapped[str] = mapped_column(Text)
    created_at: Mapped[datetime] = mapped_column(index=True)


class Upload(Base):
    """An upload in pieces (tus): the offset is the size of its file on disk, never this row's."""

    __tablename__ = "uploads"

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    size_bytes: Mapped[int] = mapped_column(BigInteger)
    meta: Mapped[dict[str, Any]]
    result: Mapped[dict[str, Any] | None]
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))
    expires_at: Mapped[datetime] = mapped_column(index=True)


class Lease(Base):
    """A right that one process has at a time, who has it, and until when."""

    __tablename__ = "leases"

    name: Mapped[str] = mapped_column(Id, primary_key=True)
    holder: Mapped[str] = mapped_column(Name)
    until: Mapped[datetime]
