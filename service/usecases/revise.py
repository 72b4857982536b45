"""Make a new revision of a map: operations on a base, put together with what others did meanwhile."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from service.db import revisions as table
from service.db.jobs import enqueue
from service.db.models import Job, Revision
from service.db.proposals import open_proposals
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import InvalidRequest, RevisionNotFound, StaleBase
from service.domain.lifecycle import JobKind, ProposalState, RevisionStatus, Role
from service.domain.map_state import Difference, MapState, Taken, differences
from service.domain.operations import Operation, SetRecipe, apply_all, effective
from service.domain.recipe import Recipe
from service.domain.together import overlap, put_together
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.map_states import layer_rows, state_of
from service.usecases.maps import covered_map
from service.usecases.plan_operations import (
    WantedDrawing,
    WantedLayer,
    WantedLayers,
    WantedOperation,
    history,
    plan,
)
from service.usecases.revisions import Shown, require_ready


@dataclass(frozen=True)
class Wanted:
    """Hold what a revision is asked to be; what is None comes from its base, or from nothing.

    Parameters
    ----------
    base : int, optional
        The revision that is changed; without one nothing is inherited.
    drawing_id : str, optional
        Needed without a base.
    recipe : mapping
        Fields that differ from the base's recipe, or from the defaults.
    layers : sequence of WantedLayer, optional
        All layers, in their order.
    operations : sequence of WantedOperation
        What is done to the base, after what the other fields ask for.
    reason : str, optional
        Why, in the words of the person who asks.
    """

    base: int | None = None
    drawing_id: str | None = None
    recipe: Mapping[str, Any] = field(default_factory=dict)
    layers: Sequence[WantedLayer] | None = None
    operations: Sequence[WantedOperation] = ()
    reason: str | None = None

    def steps(self) -> list[WantedOperation]:
        """Return everything that is asked for as operations, in their order."""
        steps: list[WantedOperation] = []
        if self.drawing_id is not None:
            steps.append(WantedDrawing(self.drawing_id))
        if self.recipe:
            steps.append(SetRecipe(self.recipe))
        if self.layers is not None:
            steps.append(WantedLayers(self.layers))
        return [*steps, *self.operations]


@dataclass(frozen=True)
class Rebased:
    """Hold that a change was put onto a later revision than the one it was made for, and what was between."""

    base: int
    onto: int
    changes: Sequence[Difference]


@dataclass(frozen=True)
class Revised:
    """Hold a new revision, building, the job that builds it, and whether it was rebased."""

    shown: Shown
    job: Job
    rebased: Rebased | None = None


def revise(kernel: Kernel, session: Session, actor: Actor, *, map_id: str, wanted: Wanted) -> Revised:
    """Return a new revision of the map, building, and its job.

    A base that is no longer the latest revision is no obstacle where others changed other things: what the
    request changes of its base is put together with what they did. A form that names everything changes
    what it names otherwise than its base.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    MapNotFound, DrawingNotFound, PlacementNotFound, RevisionNotFound, LayerNotFound, RegionNotFound
        If something named does not exist on this map for the key.
    StaleBase
        If the base is not the map's latest revision, and somebody changed the same things since.
    RevisionNotReady
        If the base has failed.
    DrawingNotRead
        If the drawing's reading has not finished.
    StorageFull
        If there is no room for what its job makes.
    ScaleUnknown
        If the drawing's scale is not known.
    PlacementNotAcceptable
        If a layer's placement is unfinished or rejected, or needs a review that nobody did.
    InvalidRequest
        If the recipe is out of its limits, a layer is named twice, or no drawing is named at all.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    covered_map(session, actor, map_id=map_id, lock=True)
    if wanted.base is not None:
        base = _living(session, map_id, wanted.base)
        operations = plan(kernel, session, map_id, wanted.steps(), state_of(session, base))
        return change(kernel, session, actor, base=base, operations=operations, reason=wanted.reason)
    empty = MapState(None, Recipe())
    state = apply_all(empty, plan(kernel, session, map_id, wanted.steps(), empty))
    if state.reading is None:
        detail = "Name a drawing, or a base revision whose drawing is kept."
        raise InvalidRequest(detail, errors=[{"pointer": "#/drawing_id", "detail": detail}])
    parent = table.latest_revision(session, map_id, status=RevisionStatus.READY)
    number = None if parent is None else parent.n
    made = _Made(map_id, state, parent_n=number, base_n=None, operations=(), reason=wanted.reason)
    return _add(kernel, session, actor, made, rebased=None)


def change(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    base: Revision,
    operations: Sequence[Operation],
    reason: str | None = None,
) -> Revised:
    """Return a new revision: what operations make of `base`, put together with the latest.

    This transaction holds the map.

    Raises
    ------
    StaleBase
        If `base` is not the latest, and somebody changed the same things since.
    LayerNotFound, RegionNotFound, InvalidRequest
        As `apply_all`.
    """
    held = state_of(session, base)
    wished = apply_all(held, operations)
    yours = differences(held, wished)
    latest = table.latest_living_revision(session, base.map_id)
    assert latest is not None
    rebased, state = None, wished
    if latest.n != base.n:
        present = state_of(session, latest)
        theirs = differences(held, present)
        shared = overlap(held, wished, present)
        if shared:
            raise _stale(base, latest, shared, yours, theirs)
        state = put_together(held, wished, present)
        rebased = Rebased(base.n, latest.n, theirs)
    made = _Made(base.map_id, state, latest.n, base.n, effective(held, operations), reason)
    _settle_proposals(kernel, session, actor, base.map_id, yours)
    return _add(kernel, session, actor, made, rebased=rebased)


def _settle_proposals(
    kernel: Kernel, session: Session, actor: Actor, map_id: str, changed: Sequence[Difference]
) -> None:
    """Close what was proposed about layers that are removed, replaced or moved: that is no more."""
    moot = [
        one.before["layer_id"]
        for one in changed
        if one.change in {"removed", "replaced", "moved"} and one.before is not None
    ]
    for row in open_proposals(session, map_id, layer_ids=moot):
        row.state, row.decided_at = ProposalState.DISMISSED.value, kernel.now()
        row.decided_by = actor.key_id


def _living(session: Session, map_id: str, n: int) -> Revision:
    named = table.find_revision(session, map_id, n=n)
    if named is None:
        raise RevisionNotFound(f"The map {map_id} has no revision {n}.")
    if named.status == RevisionStatus.FAILED:
        require_ready(named)
    return named


def _stale(
    base: Revision,
    latest: Revision,
    shared: Collection[str],
    yours: Sequence[Difference],
    theirs: Sequence[Difference],
) -> StaleBase:
    told = " ".join(one.message for one in theirs if one.subject in shared)
    return StaleBase(
        f"Since revision {base.n} somebody changed the same: {told} "
        f"Look at revision {latest.n}, and ask again with it as the base.",
        base=base.n,
        latest=latest.n,
        overlap=sorted(shared),
        theirs=[one.to_json() for one in theirs],
        yours=[one.to_json() for one in yours],
    )


@dataclass(frozen=True)
class _Made:
    """Hold what a new revision will be."""

    map_id: str
    state: MapState
    parent_n: int | None
    base_n: int | None
    operations: Sequence[Operation]
    reason: str | None


def _add(kernel: Kernel, session: Session, actor: Actor, made: _Made, *, rebased: Rebased | None) -> Revised:
    """Return the new revision's rows and job, of a map that this transaction holds."""
    now, state = kernel.now(), made.state
    assert state.reading is not None
    kernel.room.require()
    revision_id = kernel.new_id("rev")
    job = enqueue(
        session,
        JobKind.BUILD_REVISION,
        job_id=kernel.new_id("job"),
        map_id=made.map_id,
        subject_id=revision_id,
        key_id=actor.key_id,
        now=now,
    )
    revision = Revision(
        id=revision_id,
        map_id=made.map_id,
        n=table.take_number(session, made.map_id),
        parent_n=made.parent_n,
        base_n=made.base_n,
        status=RevisionStatus.BUILDING.value,
        recipe=state.recipe.to_json(),
        drawing_id=state.reading.drawing_id,
        walls_sha256=state.reading.walls_sha256,
        scale=state.reading.scale,
        drawing_frame=None if state.reading.frame is None else state.reading.frame.to_json(),
        erased=[one.to_json() for one in state.erased],
        operations=history(made.operations),
        reason=made.reason,
        job_id=job.id,
        created_at=now,
        created_by=actor.key_id,
    )
    rows = layer_rows(kernel, revision_id, state, made=Taken(actor.key_id, now))
    table.add_revision(session, revision, rows)
    after = {"n": revision.n, "parent_n": made.parent_n, "operations": revision.operations}
    record(
        kernel,
        session,
        actor,
        action="revise",
        subject_id=revision_id,
        map_id=made.map_id,
        before=None if made.parent_n is None else {"n": made.parent_n},
        after={**after, "reason": made.reason},
    )
    return Revised(Shown(revision, rows), job, rebased)
