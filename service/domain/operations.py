"""What can be done to a map: each operation takes a state to another, and does nothing else."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from service.domain.errors import InvalidRequest, LayerNotFound, RegionNotFound
from service.domain.history import DoneOperation, Shift
from service.domain.layer_part import LayerPart
from service.domain.map_state import BaseReading, ErasedRegion, LayerState, MapState, Pose, pose_of
from service.domain.recipe import Recipe
from service.domain.region import MAX_REGIONS, Region
from service.domain.transform import Transform

MAX_LAYERS = 1000


class Operation(Protocol):
    """One step from a state to another."""

    def apply(self, state: MapState) -> MapState:
        """Return the state after the step.

        Raises
        ------
        LayerNotFound, RegionNotFound
            If it names what the state does not have.
        InvalidRequest
            If the state after it would break a rule.
        """
        ...

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        ...


@dataclass(frozen=True)
class AddLayer:
    """Put a placed scan on top."""

    layer: LayerState

    def apply(self, state: MapState) -> MapState:
        """Return the state with the layer last; see `Operation.apply`."""
        if any(layer.placement_id == self.layer.placement_id for layer in state.layers):
            raise _invalid(f"The placement {self.layer.placement_id} is a layer already.")
        return _with_layers(state, (*state.layers, self.layer))

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        it = self.layer
        return DoneOperation("add-layer", layer_id=it.layer_id, placement_id=it.placement_id, name=it.name)


@dataclass(frozen=True)
class MoveLayer:
    """Take a layer to another pose."""

    layer_id: str
    T_map_scan: Pose

    def apply(self, state: MapState) -> MapState:
        """Return the state with the layer there; see `Operation.apply`."""
        return _changed(state, self.layer_id, T_map_scan=self.T_map_scan)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("move-layer", layer_id=self.layer_id, T_map_scan=self.T_map_scan)


@dataclass(frozen=True)
class ShiftLayer:
    """Move a layer from where it lies: along the map's axes [m], turned about its scan's origin [rad]."""

    layer_id: str
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_rad: float = 0.0

    def apply(self, state: MapState) -> MapState:
        """Return the state with the layer there; see `Operation.apply`."""
        pose = Transform.of(_layer(state, self.layer_id).T_map_scan)
        turned = Transform.from_xyz_yaw(0.0, 0.0, 0.0, self.yaw_rad).matrix @ pose.matrix
        turned[:3, 3] = [
            at + by for at, by in zip(pose.translation, (self.x_m, self.y_m, self.z_m), strict=True)
        ]
        return _changed(state, self.layer_id, T_map_scan=pose_of(turned.tolist()))

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        by = Shift(self.x_m, self.y_m, self.z_m, self.yaw_rad)
        return DoneOperation("move-layer", layer_id=self.layer_id, by=by)


@dataclass(frozen=True)
class ReplaceLayer:
    """Put another placed scan in a layer's stead; regions erased from the old one do not touch the new."""

    layer_id: str
    scan_id: str
    placement_id: str
    part: dict[str, Any] | None
    T_map_scan: Pose
    name: str | None = None

    def apply(self, state: MapState) -> MapState:
        """Return the state with the other scan; see `Operation.apply`."""
        old = _layer(state, self.layer_id)
        if any(x.placement_id == self.placement_id for x in state.layers):
            raise _invalid(f"The placement {self.placement_id} is a layer already.")
        erased = tuple(replace(one, layers=_without(one.layers, self.layer_id)) for one in state.erased)
        return _changed(
            replace(state, erased=erased),
            self.layer_id,
            scan_id=self.scan_id,
            placement_id=self.placement_id,
            part=self.part,
            T_map_scan=self.T_map_scan,
            name=self.name or old.name,
            taken=None,
        )

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("replace-layer", layer_id=self.layer_id, placement_id=self.placement_id)


@dataclass(frozen=True)
class ShowLayer:
    """Show a layer, or hide it: a hidden one stays in the revision and out of its files."""

    layer_id: str
    visible: bool

    def apply(self, state: MapState) -> MapState:
        """Return the state with the layer shown or hidden; see `Operation.apply`."""
        return _changed(state, self.layer_id, visible=self.visible)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("show-layer" if self.visible else "hide-layer", layer_id=self.layer_id)


@dataclass(frozen=True)
class RenameLayer:
    """Call a layer something else."""

    layer_id: str
    name: str

    def apply(self, state: MapState) -> MapState:
        """Return the state with the name; see `Operation.apply`."""
        return _changed(state, self.layer_id, name=self.name)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("rename-layer", layer_id=self.layer_id, name=self.name)


@dataclass(frozen=True)
class CutLayer:
    """Choose anew which of its scan's points a layer holds."""

    layer_id: str
    part: dict[str, Any]

    def apply(self, state: MapState) -> MapState:
        """Return the state with the other part; see `Operation.apply`."""
        return _changed(state, self.layer_id, part=self.part)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("cut-layer", layer_id=self.layer_id, part=LayerPart.from_json(self.part))


@dataclass(frozen=True)
class RemoveLayer:
    """Take a layer off; earlier revisions keep it."""

    layer_id: str

    def apply(self, state: MapState) -> MapState:
        """Return the state without the layer; see `Operation.apply`."""
        gone = _layer(state, self.layer_id)
        erased = tuple(replace(one, layers=_without(one.layers, self.layer_id)) for one in state.erased)
        kept = tuple(layer for layer in state.layers if layer is not gone)
        return replace(state, layers=kept, erased=erased)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("remove-layer", layer_id=self.layer_id)


@dataclass(frozen=True)
class SetLayers:
    """Name all layers at once, in their order."""

    layers: tuple[LayerState, ...]

    def apply(self, state: MapState) -> MapState:
        """Return the state with these layers; see `Operation.apply`."""
        kept = {layer.layer_id: layer.placement_id for layer in self.layers}
        same = {x.layer_id for x in state.layers if kept.get(x.layer_id) == x.placement_id}
        erased = tuple(
            replace(one, layers={k: v for k, v in one.layers.items() if k in same}) for one in state.erased
        )
        return _with_layers(replace(state, erased=erased), self.layers)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("set-layers", layer_ids=tuple(layer.layer_id for layer in self.layers))


@dataclass(frozen=True)
class EraseRegion:
    """Take off what stands in a region now.

    Parameters
    ----------
    drawing : bool
        Whether walls, floor and ceiling are erased.
    layer_ids : sequence of str, optional
        Only from these layers; None is all there are.
    """

    region_id: str
    region: Region
    drawing: bool = True
    layer_ids: Sequence[str] | None = None

    def apply(self, state: MapState) -> MapState:
        """Return the state with the region erased; see `Operation.apply`."""
        if len(state.erased) >= MAX_REGIONS:
            raise _invalid(f"A map has at most {MAX_REGIONS} erased regions; restore or merge some.")
        layers = state.layers if self.layer_ids is None else [_layer(state, one) for one in self.layer_ids]
        poses = {layer.layer_id: layer.T_map_scan for layer in layers}
        return replace(
            state, erased=(*state.erased, ErasedRegion(self.region_id, self.region, self.drawing, poses))
        )

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("erase-region", region_id=self.region_id, region=self.region)


@dataclass(frozen=True)
class RestoreRegion:
    """Bring back what was taken off by an erased region."""

    region_id: str

    def apply(self, state: MapState) -> MapState:
        """Return the state with the region restored; see `Operation.apply`."""
        kept = tuple(one for one in state.erased if one.region_id != self.region_id)
        if len(kept) == len(state.erased):
            known = ", ".join(one.region_id for one in state.erased) or "none"
            raise RegionNotFound(f"There is no erased region {self.region_id}; there is {known}.")
        return replace(state, erased=kept)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("restore-region", region_id=self.region_id)


@dataclass(frozen=True)
class SetRecipe:
    """Change fields of the recipe; the others stay."""

    fields: Mapping[str, Any]

    def apply(self, state: MapState) -> MapState:
        """Return the state with the recipe changed; see `Operation.apply`."""
        return replace(state, recipe=Recipe.from_json({**state.recipe.to_json(), **self.fields}))

    def narrowed(self, state: MapState) -> SetRecipe:
        """Return the operation with those fields alone that differ in the state."""
        old, new = state.recipe.to_json(), self.apply(state).recipe.to_json()
        return SetRecipe({name: self.fields[name] for name in self.fields if new[name] != old[name]})

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("set-recipe", recipe=self.fields)


@dataclass(frozen=True)
class SetDrawing:
    """Put another drawing, or another reading of the same, under the layers."""

    reading: BaseReading

    def apply(self, state: MapState) -> MapState:
        """Return the state with the other drawing; see `Operation.apply`."""
        return replace(state, reading=self.reading)

    def done(self) -> DoneOperation:
        """Return the operation as a revision's history keeps it."""
        return DoneOperation("set-drawing", drawing_id=self.reading.drawing_id)


def apply_all(state: MapState, operations: Iterable[Operation]) -> MapState:
    """Return the state after every operation, in their order.

    Raises
    ------
    LayerNotFound, RegionNotFound, InvalidRequest
        As `Operation.apply`; the place is named.
    """
    for operation in operations:
        state = operation.apply(state)
    return state


def effective(state: MapState, operations: Iterable[Operation]) -> list[Operation]:
    """Return those of the operations that change something, each applied after those before.

    Of a recipe the fields that change: a form names all of them.

    Raises
    ------
    LayerNotFound, RegionNotFound, InvalidRequest
        As `Operation.apply`.
    """
    kept: list[Operation] = []
    for operation in operations:
        after = operation.apply(state)
        if after != state:
            kept.append(operation.narrowed(state) if isinstance(operation, SetRecipe) else operation)
        state = after
    return kept


def _layer(state: MapState, layer_id: str) -> LayerState:
    found = state.layer(layer_id)
    if found is None:
        known = ", ".join(layer.layer_id for layer in state.layers) or "none"
        raise LayerNotFound(f"There is no layer {layer_id}; there is {known}.")
    return found


def _changed(state: MapState, layer_id: str, **fields: Any) -> MapState:
    old = _layer(state, layer_id)
    return replace(state, layers=tuple(replace(x, **fields) if x is old else x for x in state.layers))


def _with_layers(state: MapState, layers: tuple[LayerState, ...]) -> MapState:
    if len(layers) > MAX_LAYERS:
        raise _invalid(f"A map has at most {MAX_LAYERS} layers.")
    return replace(state, layers=layers)


def _without(poses: Mapping[str, Pose], layer_id: str) -> dict[str, Pose]:
    return {key: pose for key, pose in poses.items() if key != layer_id}


def _invalid(detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": "#/operations", "detail": detail}])
