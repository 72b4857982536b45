"""Turn what a request asks for into operations: placements and drawings are looked up, ids are given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from service.db.models import Placement
from service.db.placements import find_placements
from service.db.session import Session
from service.domain.errors import InvalidRequest, PlacementNotFound
from service.domain.layer_part import LayerPart
from service.domain.map_state import LayerState, MapState, pose_of
from service.domain.operations import (
    AddLayer,
    CutLayer,
    EraseRegion,
    MoveLayer,
    Operation,
    RemoveLayer,
    RenameLayer,
    ReplaceLayer,
    RestoreRegion,
    SetDrawing,
    SetLayers,
    SetRecipe,
    ShiftLayer,
    ShowLayer,
)
from service.domain.region import Region
from service.usecases.kernel import Kernel
from service.usecases.map_states import reading_of
from service.usecases.placements import require_acceptable


@dataclass(frozen=True)
class WantedLayer:
    """Hold a layer that a request asks for.

    Parameters
    ----------
    placement_id : str
        A finished placement of a scan of the same map.
    name : str
        What people call the layer.
    reviewed : bool
        Whether a person has looked at a placement that needs a review.
    part : LayerPart
        Which of the scan's points it holds.
    """

    placement_id: str
    name: str
    reviewed: bool = False
    part: LayerPart = field(default_factory=LayerPart)


@dataclass(frozen=True)
class WantedReplacement:
    """Hold which layer another placed scan is to replace; the name stays where none is given."""

    layer_id: str
    placement_id: str
    name: str | None = None
    reviewed: bool = False
    part: LayerPart = field(default_factory=LayerPart)


@dataclass(frozen=True)
class WantedDrawing:
    """Hold which drawing is to lie underneath, as it is read now."""

    drawing_id: str


@dataclass(frozen=True)
class WantedErasure:
    """Hold which region is to be erased, from what; see `EraseRegion`."""

    region: Region
    drawing: bool = True
    layer_ids: Sequence[str] | None = None


@dataclass(frozen=True)
class WantedLayers:
    """Hold all layers of a revision, in their order."""

    layers: Sequence[WantedLayer]


ByItself = (
    MoveLayer | ShiftLayer | ShowLayer | RenameLayer | CutLayer | RemoveLayer | RestoreRegion | SetRecipe
)
"""Operations that a request names whole."""
WantedOperation = ByItself | WantedLayer | WantedReplacement | WantedDrawing | WantedErasure | WantedLayers


def plan(
    kernel: Kernel, session: Session, map_id: str, wanted: Sequence[WantedOperation], base: MapState
) -> list[Operation]:
    """Return the operations that a request asks for.

    Raises
    ------
    PlacementNotFound, DrawingNotFound
        If the map has no such placement or drawing.
    PlacementNotAcceptable
        If a placement is unfinished or rejected, or needs a review that nobody did.
    DrawingNotRead, ScaleUnknown
        If a drawing has no reading in metres.
    InvalidRequest
        If a layer is named twice.
    """
    found = find_placements(session, [one for step in wanted for one in _placement_ids(step)])
    return [_planned(kernel, session, map_id, step, base, found) for step in wanted]


def _planned(
    kernel: Kernel,
    session: Session,
    map_id: str,
    step: WantedOperation,
    base: MapState,
    found: Mapping[str, Placement],
) -> Operation:
    if isinstance(step, WantedLayer):
        return AddLayer(_new_layer(kernel, map_id, step, found))
    if isinstance(step, WantedReplacement):
        row = _acceptable(map_id, step.placement_id, found, reviewed=step.reviewed)
        part, pose = step.part.to_json(), pose_of(row.T_map_scan)
        return ReplaceLayer(step.layer_id, row.scan_id, row.id, part, pose, step.name)
    if isinstance(step, WantedDrawing):
        return SetDrawing(reading_of(session, map_id, step.drawing_id))
    if isinstance(step, WantedErasure):
        return EraseRegion(kernel.new_id("ers"), step.region, step.drawing, step.layer_ids)
    if isinstance(step, WantedLayers):
        return _all_layers(kernel, map_id, step.layers, base, found)
    return step


def _all_layers(
    kernel: Kernel,
    map_id: str,
    wanted: Sequence[WantedLayer],
    base: MapState,
    found: Mapping[str, Placement],
) -> SetLayers:
    """Return all layers anew; one whose placement or scan is in the base keeps its id, and its place."""
    layers: list[LayerState] = []
    for position, one in enumerate(wanted):
        if any(one.placement_id == other.placement_id for other in layers):
            detail = f"The placement {one.placement_id} is named twice."
            pointer = f"#/layers/{position}/placement_id"
            raise InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
        new = _new_layer(kernel, map_id, one, found)
        taken = {layer.layer_id for layer in layers}
        free = [layer for layer in base.layers if layer.layer_id not in taken]
        layers.append(_continued(new, free))
    return SetLayers(tuple(layers))


def _continued(new: LayerState, earlier: Sequence[LayerState]) -> LayerState:
    same = next((x for x in earlier if x.placement_id == new.placement_id), None)
    if same is not None:
        return replace(same, name=new.name, part=new.part)
    of_scan = next((x for x in earlier if x.scan_id == new.scan_id), None)
    layer_id = new.layer_id if of_scan is None else of_scan.layer_id
    return LayerState(layer_id, new.name, new.scan_id, new.placement_id, new.part, new.T_map_scan)


def _new_layer(
    kernel: Kernel, map_id: str, wanted: WantedLayer, found: Mapping[str, Placement]
) -> LayerState:
    row = _acceptable(map_id, wanted.placement_id, found, reviewed=wanted.reviewed)
    pose, part = pose_of(row.T_map_scan), wanted.part.to_json()
    return LayerState(kernel.new_id("lyr"), wanted.name, row.scan_id, row.id, part, pose)


def _acceptable(
    map_id: str, placement_id: str, found: Mapping[str, Placement], *, reviewed: bool
) -> Placement:
    row = found.get(placement_id)
    if row is None or row.map_id != map_id:
        raise PlacementNotFound(f"The map {map_id} has no placement {placement_id}.")
    require_acceptable(row, reviewed=reviewed)
    return row


def _placement_ids(step: WantedOperation) -> list[str]:
    if isinstance(step, WantedLayer | WantedReplacement):
        return [step.placement_id]
    return [one.placement_id for one in step.layers] if isinstance(step, WantedLayers) else []


def history(operations: Sequence[Operation]) -> list[dict[str, Any]]:
    """Return operations as a revision's history keeps them."""
    return [one.done().to_json() for one in operations]
