"""Move a channel's pointer, and tell where it points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from service.db import revisions as table
from service.db.models import Artifact, Channel, Drawing, Publication, Revision
from service.db.placements import find_placements
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import GatesClosed, NothingPublished, PointerMoved
from service.domain.gates import Gate, JudgedLayer, closed_gates
from service.domain.lifecycle import Role
from service.domain.reasons import kept_reasons
from service.usecases.audit import record
from service.usecases.deltas import foresee_delta
from service.usecases.events import tell_published
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.revisions import ready_revision
from service.usecases.rollout_members import refuse_under_way


@dataclass(frozen=True)
class Published:
    """Hold a channel's pointer, a revision that is had from there, and the files of this revision."""

    pointer: Channel
    n: int
    artifacts: Sequence[Artifact]


@dataclass(frozen=True)
class Said:
    """Hold what an admin says of a publication.

    Parameters
    ----------
    reason : str, optional
        Why, for the history.
    override : str, optional
        Why it is published although gates are closed; kept with the gates and the admin's key.
    """

    reason: str | None = None
    override: str | None = None


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
    said: Said | None = None,
) -> Published:
    """Return the channel, now pointing to revision `n`; pointing to an earlier one rolls back.

    A channel that points there already stays as it is. A revision that was on the channel before passes
    its gates: rolling back is never held up.

    Parameters
    ----------
    holds : callable, optional
        The caller's condition on the present `pointer_tag` (None: nothing is published yet).
    said : Said, optional
        Why it is done, and whether closed gates are overridden.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    MapNotFound, RevisionNotFound
        If there is no such map or revision for the key.
    RevisionNotReady
        If the revision is building, or failed.
    GatesClosed
        If something stands against it, and nobody overrides that.
    RevisionPruned
        If its files were let go.
    RolloutUnderWay
        If the channel has a roll-out that has not ended.
    PointerMoved
        If `holds` says that the pointer is not where the caller saw it.
    """
    actor.require_role(Role.ADMIN)
    covered_map(session, actor, map_id=map_id, lock=True)
    revision = ready_revision(session, actor, map_id=map_id, n=n)
    refuse_under_way(session, map_id, channel=channel)
    pointer = table.find_channel(session, map_id, channel=channel)
    if holds is not None and not holds(None if pointer is None else pointer_tag(pointer)):
        raise PointerMoved(
            f"The channel {channel!r} is no longer where If-Match says.",
            revision=None if pointer is None else pointer.revision_n,
        )
    if pointer is None or pointer.revision_n != n:
        override = None if said is None else said.override
        gates = pass_gates(session, revision, channel=channel, override=override)
        move = _move(kernel, actor, pointer, map_id, channel, n)
        move.reason = None if said is None else override or said.reason
        move.overridden = gates or None
        pointer = table.move_pointer(session, pointer, move)
        _record(kernel, session, actor, move)
        if move.from_n is not None:
            foresee_delta(kernel, session, map_id, from_n=move.from_n, to_n=n)
        tell_published(kernel, session, move)
    return Published(pointer, n, table.list_artifacts(session, revision.id))


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


def published(session: Session, pointer: Channel, *, n: int) -> Published:
    """Return the pointer with the files of revision `n`: its own, or what a roll-out gives a robot."""
    revision = table.find_revision(session, pointer.map_id, n=n)
    assert revision is not None
    return Published(pointer, n, table.list_artifacts(session, revision.id))


def list_publications(
    session: Session, actor: Actor, *, map_id: str, channel: str | None, before: str | None, limit: int
) -> Sequence[Publication]:
    """Return up to `limit` moves of a map's pointers, newest first, with ids before `before`.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    covered_map(session, actor, map_id=map_id)
    return table.list_publications(session, map_id, channel=channel, before=before, limit=limit)


def list_channels(session: Session, actor: Actor, *, map_id: str) -> Sequence[Channel]:
    """Return where each channel of a map points, by name.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    covered_map(session, actor, map_id=map_id)
    return table.list_channels(session, map_id)


def show_gates(session: Session, actor: Actor, *, map_id: str, n: int, channel: str) -> Sequence[Gate]:
    """Return what stands against publishing revision `n` on a channel.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady
        As `ready_revision`.
    """
    return _gates(session, ready_revision(session, actor, map_id=map_id, n=n), channel=channel)


def pass_gates(
    session: Session, revision: Revision, *, channel: str, override: str | None
) -> list[dict[str, Any]]:
    """Return the closed gates that `override` passes, as JSON objects; none where all are open.

    Parameters
    ----------
    override : str, optional
        Why the revision goes out although gates are closed.

    Raises
    ------
    GatesClosed
        If something stands against it, and nobody overrides that.
    """
    gates = _gates(session, revision, channel=channel)
    if gates and override is None:
        told = " ".join(gate.message for gate in gates)
        raise GatesClosed(
            f"Revision {revision.n} does not go out: {told} Settle it, or ask for it with an override.",
            gates=[gate.to_json() for gate in gates],
        )
    return [gate.to_json() for gate in gates]


def _gates(session: Session, revision: Revision, *, channel: str) -> list[Gate]:
    if table.was_published(session, revision.map_id, channel=channel, n=revision.n):
        return []
    rows = [row for row in table.layers_of(session, [revision.id])[revision.id] if row.visible]
    placements = find_placements(session, [row.placement_id for row in rows])
    layers = [
        JudgedLayer(row.layer_id, row.name, str(found.verdict), kept_reasons(found.reasons))
        for row in rows
        if (found := placements.get(row.placement_id)) is not None
    ]
    drawing = session.get_one(Drawing, revision.drawing_id)
    return closed_gates(
        layers,
        drawing_id=drawing.id,
        findings=(drawing.reading or {}).get("findings", ()),
    )


def _record(kernel: Kernel, session: Session, actor: Actor, move: Publication) -> None:
    after = {"channel": move.channel, "n": move.to_n, "reason": move.reason, "overridden": move.overridden}
    record(
        kernel,
        session,
        actor,
        action="publish",
        subject_id=move.id,
        map_id=move.map_id,
        before={"channel": move.channel, "n": move.from_n},
        after=after,
    )


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
