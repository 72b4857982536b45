"""Take a placement into the map: a new revision that has the placed scan as a layer."""

from __future__ import annotations

from service.db import revisions as table
from service.db.models import Placement, Revision
from service.db.session import Session
from service.db.uploads import find_scan_row
from service.domain.access import Actor
from service.domain.errors import PlacementNotAcceptable
from service.domain.layer_part import LayerPart
from service.domain.lifecycle import Role
from service.domain.map_state import (
    DRAWING,
    MAP_FROM_DRAWING,
    LayerState,
    MapState,
    differences,
    pose_of,
    subjects,
)
from service.domain.operations import AddLayer, ReplaceLayer
from service.usecases.kernel import Kernel
from service.usecases.map_states import state_of
from service.usecases.maps import covered_map
from service.usecases.placements import covered_placement, require_acceptable
from service.usecases.proposals import propose
from service.usecases.revise import Revised, change


def accept_placement(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    placement_id: str,
    reviewed: bool,
    name: str | None = None,
    part: LayerPart | None = None,
) -> Revised:
    """Return a new revision: the map's latest with the placed scan on top, and its job.

    A layer of the same scan is replaced where it stands. What others did since the revision that the
    scan was placed on stays, unless it was done to the same scan.

    Parameters
    ----------
    reviewed : bool
        Whether a person has looked at a placement that needs a review.
    name : str, optional
        What people call the layer; by default the scan's file name.
    part : LayerPart, optional
        Which of the scan's points are taken; by default the target, what the map does not explain.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    PlacementNotFound
        If there is no such placement for the key.
    PlacementNotAcceptable
        If it is unfinished or rejected, needs a review that nobody did, is in the map already, or was
        found on walls that are no longer the map's and nobody reviewed it since.
    StaleBase
        If somebody took in, replaced or removed a layer of the same scan since.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    row = covered_placement(session, actor, placement_id=placement_id)
    covered_map(session, actor, map_id=row.map_id, lock=True)
    require_acceptable(row, reviewed=reviewed)
    base = table.find_revision(session, row.map_id, n=row.revision_n)
    latest = table.latest_living_revision(session, row.map_id)
    assert base is not None
    assert latest is not None
    held, present = state_of(session, base), state_of(session, latest)
    if any(layer.placement_id == row.id for layer in present.layers):
        raise PlacementNotAcceptable(
            f"The placement {row.id} is a layer of revision {latest.n} already.",
            verdict=row.verdict,
            n=latest.n,
        )
    if not reviewed:
        _require_same_walls(row, latest, held, present)
    propose(kernel, session, row, (row.evidence or {}).get("gone", ()))
    step = _step(kernel, session, row, held, name=name, part=part or LayerPart())
    return change(kernel, session, actor, base=base, operations=[step])


def _step(
    kernel: Kernel, session: Session, row: Placement, held: MapState, *, name: str | None, part: LayerPart
) -> AddLayer | ReplaceLayer:
    """Return the operation: a layer of the same scan is replaced where it stands."""
    pose, taken = pose_of(row.T_map_scan), part.to_json()
    same = next((layer for layer in held.layers if layer.scan_id == row.scan_id), None)
    if same is not None:
        return ReplaceLayer(same.layer_id, row.scan_id, row.id, taken, pose, name)
    shown = name or _file_name(session, row)
    return AddLayer(LayerState(kernel.new_id("lyr"), shown, row.scan_id, row.id, taken, pose))


def _require_same_walls(row: Placement, latest: Revision, held: MapState, present: MapState) -> None:
    """Pass when the walls that the scan was placed on are still those of the map."""
    changed = subjects(differences(held, present)) & {DRAWING, MAP_FROM_DRAWING}
    if changed:
        raise PlacementNotAcceptable(
            f"The placement {row.id} was found on revision {row.revision_n}; since then the walls were "
            f"changed ({', '.join(sorted(changed))}). Place the scan on revision {latest.n}, or look at it "
            "and send reviewed = true.",
            verdict=row.verdict,
            n=latest.n,
        )


def _file_name(session: Session, row: Placement) -> str:
    found = find_scan_row(session, row.scan_id)
    assert found is not None
    return found[0].file_name[:200]
