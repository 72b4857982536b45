"""Proposals to take off what a later scan looked through: made with a placement, decided by a person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from service.db import proposals as table
from service.db import revisions as revision_table
from service.db.models import Placement
from service.db.proposals import Proposal
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import LayerNotFound, ProposalDecided, ProposalNotFound
from service.domain.lifecycle import ProposalState, Role
from service.domain.operations import EraseRegion, Operation, RemoveLayer
from service.domain.region import Region
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.map_states import state_of
from service.usecases.maps import covered_map
from service.usecases.revise import Revised, change


def propose(
    kernel: Kernel, session: Session, placement: Placement, gone: Sequence[Mapping[str, Any]]
) -> None:
    """Propose to take off the layers that a placed scan looked through; a second time changes nothing.

    Parameters
    ----------
    gone : sequence of mapping
        Of each layer its `layer_id`, whether the `whole_layer` has gone, and the `things` that have, each
        with its `region` and the counts that tell so.
    """
    for one in gone:
        if table.find_about(session, placement.id, layer_id=one["layer_id"]) is None:
            row = Proposal(
                id=kernel.new_id("prp"),
                map_id=placement.map_id,
                placement_id=placement.id,
                layer_id=one["layer_id"],
                state=ProposalState.OPEN.value,
                evidence=dict(one),
                created_at=kernel.now(),
            )
            session.add(row)


def list_proposals(
    session: Session,
    actor: Actor,
    *,
    map_id: str | None,
    state: ProposalState | None,
    before: str | None,
    limit: int,
) -> Sequence[Proposal]:
    """Return up to `limit` proposals of a map, or of all that the key covers, newest first, before `before`.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    covered = actor.map_ids
    if map_id is not None:
        covered = frozenset({covered_map(session, actor, map_id=map_id).id})
    return table.list_proposals(session, covered=covered, state=state, before=before, limit=limit)


def accept_proposal(kernel: Kernel, session: Session, actor: Actor, *, proposal_id: str) -> Revised:
    """Return a new revision without what has gone: the map's latest, regions of the layer erased.

    Where most of the layer has gone, it is removed.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    ProposalNotFound
        If there is no such proposal for the key.
    ProposalDecided
        If somebody decided it before.
    LayerNotFound
        If the latest revision has no such layer any more: dismiss the proposal.
    """
    row = _open(session, actor, proposal_id)
    latest = revision_table.latest_living_revision(session, row.map_id)
    if latest is None or state_of(session, latest).layer(row.layer_id) is None:
        raise LayerNotFound(f"The layer {row.layer_id} is no longer in the map; dismiss the proposal.")
    told = f"a later scan looked through it (proposal {row.id})"
    made = change(kernel, session, actor, base=latest, operations=_steps(kernel, row), reason=told)
    row.revision_n = made.shown.revision.n
    _decide(kernel, session, actor, row, ProposalState.ACCEPTED)
    return made


def dismiss_proposal(kernel: Kernel, session: Session, actor: Actor, *, proposal_id: str) -> Proposal:
    """Return the proposal, dismissed: the layer stays.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    ProposalNotFound
        If there is no such proposal for the key.
    ProposalDecided
        If somebody decided it before.
    """
    row = _open(session, actor, proposal_id)
    _decide(kernel, session, actor, row, ProposalState.DISMISSED)
    return row


def _steps(kernel: Kernel, row: Proposal) -> list[Operation]:
    """Return what takes off the things that have gone: regions of the layer, or the layer itself."""
    if row.evidence.get("whole_layer", True):
        return [RemoveLayer(row.layer_id)]
    regions = [Region.from_json(one["region"], "#/region") for one in row.evidence["things"]]
    return [
        EraseRegion(kernel.new_id("ers"), region, drawing=False, layer_ids=[row.layer_id])
        for region in regions
    ]


def _open(session: Session, actor: Actor, proposal_id: str) -> Proposal:
    actor.require_role(Role.TABLET, Role.ADMIN)
    missing = ProposalNotFound(f"There is no proposal {proposal_id}, or this key does not cover its map.")
    row = table.find_proposal(session, proposal_id)
    if row is None:
        raise missing
    actor.require_map(row.map_id, otherwise=missing)
    covered_map(session, actor, map_id=row.map_id, lock=True)
    session.refresh(row, with_for_update=True)
    if row.state != ProposalState.OPEN:
        raise ProposalDecided(f"The proposal {proposal_id} is {row.state} already.", state=row.state)
    return row


def _decide(kernel: Kernel, session: Session, actor: Actor, row: Proposal, state: ProposalState) -> None:
    row.state, row.decided_at, row.decided_by = state.value, kernel.now(), actor.key_id
    session.flush()
    record(
        kernel,
        session,
        actor,
        action="decide-proposal",
        subject_id=row.id,
        map_id=row.map_id,
        before={"state": ProposalState.OPEN.value},
        after={"state": state.value, "layer_id": row.layer_id, "revision": row.revision_n},
    )
