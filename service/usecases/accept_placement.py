"""Take a placement into the map: a new revision that has the placed scan as a layer."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db.models import Placement
from service.db.uploads import find_scan_row
from service.domain.access import Actor
from service.domain.errors import PlacementNotAcceptable
from service.domain.layer_part import LayerPart
from service.domain.lifecycle import Role
from service.domain.recipe import Recipe
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.placements import covered_placement, require_acceptable
from service.usecases.revise import (
    PlannedLayer,
    Revised,
    add_revision,
    kept_layers,
    kept_reading,
    latest_base,
)


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

    A layer of the same scan is replaced where it stands.

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
        If it is unfinished or rejected, needs a review that nobody did, or is in the map already.
    RevisionNotReady
        If the map's latest revision is still building.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    row = covered_placement(session, actor, placement_id=placement_id)
    covered_map(session, actor, map_id=row.map_id, lock=True)
    require_acceptable(row, reviewed=reviewed)
    base = latest_base(session, row.map_id, base=None)
    layers = kept_layers(session, base)
    if any(layer.placement_id == row.id for layer in layers):
        raise PlacementNotAcceptable(
            f"The placement {row.id} is a layer of revision {base.n} already.", verdict=row.verdict, n=base.n
        )
    taken = (part or LayerPart()).to_json()
    new = PlannedLayer(name or _file_name(session, row), row.scan_id, row.id, taken)
    return add_revision(
        kernel,
        session,
        actor,
        parent=base,
        map_id=row.map_id,
        reading=kept_reading(base),
        recipe=Recipe.from_json(base.recipe),
        layers=_with(layers, new),
    )


def _with(layers: list[PlannedLayer], new: PlannedLayer) -> list[PlannedLayer]:
    if any(layer.scan_id == new.scan_id for layer in layers):
        return [new if layer.scan_id == new.scan_id else layer for layer in layers]
    return [*layers, new]


def _file_name(session: Session, row: Placement) -> str:
    found = find_scan_row(session, row.scan_id)
    assert found is not None
    return found[0].file_name[:200]
