"""Which revisions may let their files go, and which stored bytes nothing names any more."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import datetime

from sqlalchemy import ColumnElement, delete, exists, func, not_, or_, select, update
from sqlalchemy.orm import Session

from service.db.comparisons import Comparison
from service.db.deltas import Delta
from service.db.exports import Export
from service.db.models import Artifact, Base, Blob, Channel, Job, Placement, Publication, Revision
from service.db.robots import Robot
from service.db.rollouts import under_way
from service.domain.lifecycle import JobState, RevisionStatus

_LIVING = (JobState.QUEUED.value, JobState.RUNNING.value)


def crowded_maps(session: Session, *, keep: int) -> Sequence[str]:
    """Return the maps that have files of more than `keep` ready revisions."""
    kept = Revision.status == RevisionStatus.READY.value, Revision.pruned_at.is_(None)
    query = select(Revision.map_id).where(*kept).group_by(Revision.map_id).having(func.count() > keep)
    return session.scalars(query.order_by(Revision.map_id)).all()


def prunable(session: Session, map_id: str, *, keep: int) -> Sequence[Revision]:
    """Return the ready revisions whose files nothing needs: older than the newest `keep`, and not in use.

    In use is what a channel points to or would roll back to, what a robot runs or told of last, what a scan
    is being placed on, what a roll-out brings or would take back, and what a waiting job is about: a build,
    an export, a comparison or a delta.
    """
    ready = (
        Revision.map_id == map_id,
        Revision.status == RevisionStatus.READY.value,
        Revision.pruned_at.is_(None),
    )
    newest = select(Revision.n).where(*ready).order_by(Revision.n.desc()).limit(keep)
    wanted = select(Revision).where(*ready, Revision.n.not_in(newest), not_(or_(*_uses(map_id))))
    return session.scalars(wanted.order_by(Revision.n)).all()


def _uses(map_id: str) -> list[ColumnElement[bool]]:
    latest_move = (
        select(Publication.from_n)
        .join(
            Channel,
            (Channel.map_id == Publication.map_id)
            & (Channel.name == Publication.channel)
            & (Channel.generation == Publication.generation),
        )
        .where(Publication.map_id == map_id, Publication.from_n.is_not(None))
    )
    placing = (
        select(Placement.revision_n)
        .join(Job, Job.id == Placement.job_id)
        .where(Placement.map_id == map_id, Job.state.in_(_LIVING))
    )
    return [
        Revision.n.in_(select(Channel.revision_n).where(Channel.map_id == map_id)),
        Revision.n.in_(latest_move),
        Revision.n.in_(select(Robot.enabled_n).where(Robot.map_id == map_id, Robot.enabled_n.is_not(None))),
        Revision.n.in_(select(Robot.reported_n).where(Robot.map_id == map_id, Robot.reported_n.is_not(None))),
        Revision.n.in_(placing),
        Revision.n.in_(under_way(map_id)),
        exists(select(Job.id).where(Job.subject_id == Revision.id, Job.state.in_(_LIVING))),
        *_worked_on(),
    ]


def _worked_on() -> list[ColumnElement[bool]]:
    """Return what of a revision's files a waiting job reads: for an export, a comparison, a delta."""
    of_export = select(Export.id).where(Export.revision_id == Revision.id)
    sides = or_(Comparison.from_revision_id == Revision.id, Comparison.to_revision_id == Revision.id)
    of_comparison = select(Comparison.id).where(sides)
    ends = or_(Delta.from_sha256 == Artifact.sha256, Delta.to_sha256 == Artifact.sha256)
    of_delta = select(Delta.id).join(Artifact, ends).where(Artifact.revision_id == Revision.id)
    return [
        exists(query.join(Job, Job.id == table.job_id).where(Job.state.in_(_LIVING)))
        for query, table in ((of_export, Export), (of_comparison, Comparison), (of_delta, Delta))
    ]


def prune(session: Session, revision: Revision, *, now: datetime) -> list[str]:
    """Take a revision's files off, with deltas, exports and comparisons; return the blobs that they named."""
    files = session.scalars(select(Artifact.sha256).where(Artifact.revision_id == revision.id)).all()
    gone = set(files)
    old_deltas = or_(Delta.from_sha256.in_(gone), Delta.to_sha256.in_(gone))
    of_revision = or_(Comparison.from_revision_id == revision.id, Comparison.to_revision_id == revision.id)
    gone |= {sha for sha in session.scalars(select(Delta.sha256).where(old_deltas)) if sha}
    gone |= {sha for sha in session.scalars(select(Comparison.picture_sha256).where(of_revision)) if sha}
    exports = Export.revision_id == revision.id
    gone |= {sha for sha in session.scalars(select(Export.sha256).where(exports)) if sha}
    session.execute(delete(Export).where(exports))
    session.execute(delete(Delta).where(old_deltas))
    session.execute(delete(Comparison).where(of_revision))
    session.execute(delete(Artifact).where(Artifact.revision_id == revision.id))
    session.execute(update(Revision).where(Revision.id == revision.id).values(pruned_at=now))
    return sorted(gone)


def forget_blobs(session: Session, sha256s: Collection[str]) -> int:
    """Return how many of the blobs lost their row, since no other names them; their bytes are swept later."""
    named = [
        exists(select(1).select_from(table).where(key.parent == Blob.sha256))
        for table in Base.metadata.sorted_tables
        for key in table.foreign_keys
        if key.column is Blob.__table__.c.sha256
    ]
    unnamed = select(Blob.sha256).where(Blob.sha256.in_(sha256s), not_(or_(*named)))
    found = session.scalars(unnamed).all()
    session.execute(delete(Blob).where(Blob.sha256.in_(found)))
    return len(found)
