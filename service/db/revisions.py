"""Revisions, their layers and artifacts, and the pointers that publish them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from service.db.models import Artifact, Blob, Channel, Layer, Map, Placement, Publication, Revision, Scan
from service.db.narrowing import Narrowing, narrowed
from service.domain.lifecycle import RevisionStatus

PlacedRow = tuple[Layer, Scan, Placement]
"""A layer with its scan and its placement."""


def find_revision(session: Session, map_id: str, *, n: int) -> Revision | None:
    """Return revision `n` of a map, or None."""
    return session.scalars(select(Revision).where(Revision.map_id == map_id, Revision.n == n)).one_or_none()


def lock_revision(session: Session, revision_id: str) -> Revision:
    """Return the revision with this id; no other transaction changes it meanwhile."""
    return session.get_one(Revision, revision_id, with_for_update=True, populate_existing=True)


def narrowed_revisions(session: Session, wanted: Narrowing) -> Sequence[Revision]:
    """Return the revisions that are wanted."""
    return session.scalars(narrowed(select(Revision), Revision, wanted, prefix="rev")).all()


def latest_revision(session: Session, map_id: str, *, status: RevisionStatus) -> Revision | None:
    """Return the revision of this status with the highest number, or None."""
    return session.scalars(
        select(Revision)
        .where(Revision.map_id == map_id, Revision.status == status.value)
        .order_by(Revision.n.desc())
        .limit(1)
    ).one_or_none()


def latest_living_revision(session: Session, map_id: str) -> Revision | None:
    """Return the revision with the highest number that is ready or may become so, or None."""
    return session.scalars(
        select(Revision)
        .where(Revision.map_id == map_id, Revision.status != RevisionStatus.FAILED.value)
        .order_by(Revision.n.desc())
        .limit(1)
    ).one_or_none()


def latest_revisions(session: Session, *, limit: int) -> Sequence[Revision]:
    """Return the revisions of all maps that were made last, newest first."""
    return session.scalars(select(Revision).order_by(Revision.id.desc()).limit(limit)).all()


def list_revisions(
    session: Session, map_id: str, *, status: RevisionStatus | None, below: int | None, limit: int
) -> Sequence[Revision]:
    """Return up to `limit` revisions of a map, newest first, with numbers below `below`."""
    query = select(Revision).where(Revision.map_id == map_id).order_by(Revision.n.desc()).limit(limit)
    if status is not None:
        query = query.where(Revision.status == status.value)
    if below is not None:
        query = query.where(Revision.n < below)
    return session.scalars(query).all()


def take_number(session: Session, map_id: str) -> int:
    """Return the number of the map's next revision, taken in this transaction."""
    following: int = session.execute(
        update(Map)
        .where(Map.id == map_id)
        .values(next_revision=Map.next_revision + 1)
        .returning(Map.next_revision)
        .execution_options(synchronize_session=False)
    ).scalar_one()
    return following - 1


def layers_of(session: Session, revision_ids: Sequence[str]) -> dict[str, list[Layer]]:
    """Return the layers of each revision, in their order."""
    found: dict[str, list[Layer]] = {revision_id: [] for revision_id in revision_ids}
    query = select(Layer).where(Layer.revision_id.in_(revision_ids)).order_by(Layer.position)
    for layer in session.scalars(query):
        found[layer.revision_id].append(layer)
    return found


def visible_layers(session: Session, revision_id: str) -> Sequence[PlacedRow]:
    """Return the visible layers of a revision in their order, each with its scan and its placement."""
    query = (
        select(Layer, Scan, Placement)
        .join(Scan, Scan.id == Layer.scan_id)
        .join(Placement, Placement.id == Layer.placement_id)
        .where(Layer.revision_id == revision_id, Layer.visible)
        .order_by(Layer.position)
    )
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def list_artifacts(
    session: Session, revision_id: str, *, after: str | None = None, limit: int | None = None
) -> Sequence[Artifact]:
    """Return the files of a revision in the order of their paths, after the path `after`."""
    query = select(Artifact).where(Artifact.revision_id == revision_id).order_by(Artifact.path).limit(limit)
    if after is not None:
        query = query.where(Artifact.path > after)
    return session.scalars(query).all()


def find_artifact(session: Session, revision_id: str, *, path: str) -> Artifact | None:
    """Return one file of a revision, or None."""
    return session.get(Artifact, (revision_id, path))


def find_blob(session: Session, sha256: str) -> Blob | None:
    """Return the record of a blob, or None."""
    return session.get(Blob, sha256)


def find_channel(session: Session, map_id: str, *, channel: str) -> Channel | None:
    """Return the pointer of a map's channel, or None when nothing was ever published on it."""
    return session.get(Channel, (map_id, channel))


def channels_of(
    session: Session, *, covered: Collection[str] | None, map_id: str | None
) -> Sequence[Channel]:
    """Return where the channels of these maps point, by map and name; None asks for all maps."""
    query = select(Channel).order_by(Channel.map_id, Channel.name)
    if covered is not None:
        query = query.where(Channel.map_id.in_(covered))
    if map_id is not None:
        query = query.where(Channel.map_id == map_id)
    return session.scalars(query).all()


def list_channels(session: Session, map_id: str) -> Sequence[Channel]:
    """Return where each channel of a map points, by name."""
    return session.scalars(select(Channel).where(Channel.map_id == map_id).order_by(Channel.name)).all()


def was_published(session: Session, map_id: str, *, channel: str, n: int) -> bool:
    """Return whether a channel ever pointed to revision `n`."""
    wanted = select(Publication.id).where(
        Publication.map_id == map_id, Publication.channel == channel, Publication.to_n == n
    )
    return session.scalar(wanted.limit(1)) is not None


def list_publications(
    session: Session, map_id: str, *, channel: str | None, before: str | None, limit: int
) -> Sequence[Publication]:
    """Return up to `limit` moves of a map's pointers, newest first, with ids before `before`."""
    query = select(Publication).where(Publication.map_id == map_id).order_by(Publication.id.desc())
    if channel is not None:
        query = query.where(Publication.channel == channel)
    if before is not None:
        query = query.where(Publication.id < before)
    return session.scalars(query.limit(limit)).all()


def add_revision(session: Session, revision: Revision, layers: Sequence[Layer]) -> None:
    """Add a revision, then its layers."""
    session.add(revision)
    session.flush()
    session.add_all(layers)
    session.flush()


def move_pointer(session: Session, pointer: Channel | None, publication: Publication) -> Channel:
    """Return the channel's pointer, moved as `publication` says; the move is kept."""
    if pointer is None:
        pointer = Channel(map_id=publication.map_id, name=publication.channel)
        session.add(pointer)
    pointer.revision_n = publication.to_n
    pointer.generation = publication.generation
    pointer.published_at = publication.published_at
    session.add(publication)
    session.flush()
    return pointer
