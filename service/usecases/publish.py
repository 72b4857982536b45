"""Move a channel's pointer, and tell where it points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from service.db import revisions as table
from service.db.models import Artifact, Channel, Publication
from service.domain.access import Actor
from service.domain.errors import NothingPublished, PointerMoved
from service.domain.lifecycle import Role
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.revisions import ready_revision


@dataclass(frozen=True)
class Published:
    """Hold a channel's pointer and the files of the revision that it points to."""

    pointer: Channel
    artifacts: Sequence[Artifact]


def pointer_tag(pointer: Channel) -> str:
    """Return a text that changes whenever the pointer is moved."""
    return f"{pointer.name}-{pointer.generation}"


def publish(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    map_id: str,
    n: int,
    channel: str,
    holds: Callable[[str | None], bool] | None = None,
) -> Published:
    """Return the channel, now pointing to revision `n`; pointing to an earlier one rolls back.

    A channel that points there already stays as it is.

    Parameters
    ----------
    holds : callable, optional
        The caller's condition on the present `pointer_tag` (None: nothing is published yet).

    Raises
    ------
    Forbidden
        If the actor is no admin.
    MapNotFound, RevisionNotFound
        If there is no such map or revision for the key.
    RevisionNotReady
        If the revision is building, or failed.
    PointerMoved
        If `holds` says that the pointer is not where the caller saw it.
    """
    actor.require_role(Role.ADMIN)
    covered_map(session, actor, map_id=map_id, lock=True)
    revision = ready_revision(session, actor, map_id=map_id, n=n)
    pointer = table.find_channel(session, map_id, channel=channel)
    if holds is not None and not holds(None if pointer is None else pointer_tag(pointer)):
        raise PointerMoved(
            f"The channel {channel!r} is no longer where If-Match says.",
            revision=None if pointer is None else pointer.revision_n,
        )
    if pointer is None or pointer.revision_n != n:
        pointer = table.move_pointer(session, pointer, _move(kernel, actor, pointer, map_id, channel, n))
    return Published(pointer, table.list_artifacts(session, revision.id))


def published_pointer(session: Session, actor: Actor, *, map_id: str, channel: str) -> Channel:
    """Return where a channel points.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    NothingPublished
        If nothing was ever published on the channel.
    """
    covered_map(session, actor, map_id=map_id)
    pointer = table.find_channel(session, map_id, channel=channel)
    if pointer is None:
        raise NothingPublished(f"The map {map_id} has nothing published on the channel {channel!r}.")
    return pointer


def published(session: Session, pointer: Channel) -> Published:
    """Return the pointer with the files of its revision."""
    revision = table.find_revision(session, pointer.map_id, n=pointer.revision_n)
    assert revision is not None
    return Published(pointer, table.list_artifacts(session, revision.id))


def _move(
    kernel: Kernel,
    actor: Actor,
    pointer: Channel | None,
    map_id: str,
    channel: str,
    n: int,
) -> Publication:
    return Publication(
        id=kernel.new_id("pub"),
        map_id=map_id,
        channel=channel,
        generation=1 if pointer is None else pointer.generation + 1,
        from_n=None if pointer is None else pointer.revision_n,
        to_n=n,
        published_at=kernel.now(),
        published_by=actor.key_id,
    )
