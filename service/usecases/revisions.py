"""Find and list revisions and their files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from service.db import revisions as table
from service.db.models import Artifact, Layer, Revision
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import RevisionNotFound, RevisionNotReady, RevisionPruned
from service.domain.lifecycle import RevisionStatus
from service.usecases.maps import covered_map


@dataclass(frozen=True)
class Shown:
    """Hold a revision with its layers in their order."""

    revision: Revision
    layers: Sequence[Layer]


def covered_revision(session: Session, actor: Actor, *, map_id: str, n: int) -> Revision:
    """Return revision `n` of a map that the key covers.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    RevisionNotFound
        If the map has no such revision.
    """
    covered_map(session, actor, map_id=map_id)
    row = table.find_revision(session, map_id, n=n)
    if row is None:
        raise RevisionNotFound(f"The map {map_id} has no revision {n}.")
    return row


def ready_revision(session: Session, actor: Actor, *, map_id: str, n: int) -> Revision:
    """Return revision `n` of a map that the key covers, if it can be used.

    Raises
    ------
    MapNotFound, RevisionNotFound
        As `covered_revision`.
    RevisionNotReady
        If it is still building, or failed.
    RevisionPruned
        If its files were let go.
    """
    row = covered_revision(session, actor, map_id=map_id, n=n)
    require_ready(row)
    if row.pruned_at is not None:
        raise RevisionPruned(
            f"The files of revision {n} were let go at {row.pruned_at:%Y-%m-%d %H:%M} UTC to make room; "
            f"POST /v1/maps/{map_id}/revisions/{n}/rebuild makes them again."
        )
    return row


def require_ready(row: Revision) -> None:
    """Pass when the revision can be used.

    Raises
    ------
    RevisionNotReady
        If it is still building, or failed.
    """
    if row.status != RevisionStatus.READY:
        raise RevisionNotReady(
            f"Revision {row.n} is {row.status}; its job is {row.job_id}.",
            status=row.status,
            job_id=row.job_id,
        )


def show_revision(session: Session, actor: Actor, *, map_id: str, n: int) -> Shown:
    """Return revision `n` with its layers.

    Raises
    ------
    MapNotFound, RevisionNotFound
        As `covered_revision`.
    """
    row = covered_revision(session, actor, map_id=map_id, n=n)
    return with_layers(session, [row])[0]


def list_revisions(
    session: Session,
    actor: Actor,
    *,
    map_id: str,
    status: RevisionStatus | None,
    below: int | None,
    limit: int,
) -> Sequence[Shown]:
    """Return up to `limit` revisions of a map, newest first, with numbers below `below`.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    covered_map(session, actor, map_id=map_id)
    return with_layers(
        session, table.list_revisions(session, map_id, status=status, below=below, limit=limit)
    )


def with_layers(session: Session, rows: Sequence[Revision]) -> list[Shown]:
    """Return each revision with its layers."""
    layers = table.layers_of(session, [row.id for row in rows])
    return [Shown(row, layers[row.id]) for row in rows]


def list_artifacts(
    session: Session, actor: Actor, *, map_id: str, n: int, after: str | None, limit: int
) -> Sequence[Artifact]:
    """Return up to `limit` files of a ready revision in the order of their paths.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady
        As `ready_revision`.
    """
    row = ready_revision(session, actor, map_id=map_id, n=n)
    return table.list_artifacts(session, row.id, after=after, limit=limit)
