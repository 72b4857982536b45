"""What a revision is made of: a drawing's reading, a recipe, ordered layers and erased regions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Self

from service.domain.drawing_frame import DrawingFrame
from service.domain.recipe import Recipe
from service.domain.region import Region
from service.domain.transform import Transform

Pose = tuple[tuple[float, ...], ...]
"""A `T_map_scan` as four rows of four numbers."""

DRAWING = "drawing"
MAP_FROM_DRAWING = "recipe.map_from_drawing"
ORDER = "order"


@dataclass(frozen=True)
class BaseReading:
    """Hold what a revision keeps of a drawing's reading, whatever is read of the drawing later."""

    drawing_id: str
    walls_sha256: str
    scale: dict[str, Any]
    frame: DrawingFrame | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Taken:
    """Hold who took a placement into the map, by the id of a key, and when."""

    by: str
    at: datetime


@dataclass(frozen=True)
class LayerState:
    """Hold a layer as it stands in one revision.

    Parameters
    ----------
    layer_id : str
        Stays the same from revision to revision.
    part : dict or None
        Which of the scan's points it holds, as `LayerPart.to_json` gives it; None is all of them.
    T_map_scan : Pose
        Where the scan lies now; where it was placed is its placement's own.
    taken : Taken or None
        Who took the placement in; None until a revision holds it. It makes no difference of states.
    """

    layer_id: str
    name: str
    scan_id: str
    placement_id: str
    part: dict[str, Any] | None
    T_map_scan: Pose
    visible: bool = True
    taken: Taken | None = field(default=None, compare=False)


@dataclass(frozen=True)
class ErasedRegion:
    """Hold a region whose points were taken off: those of the drawing and of the layers of that moment.

    What comes later, a new layer or another scan in an old one, is not erased by it.

    Parameters
    ----------
    region_id : str
        By which it is restored.
    drawing : bool
        Whether walls, floor and ceiling are erased.
    layers : mapping of str to Pose
        Of each layer that is erased, the pose at that moment: a layer moved later takes its hole along.
    """

    region_id: str
    region: Region
    drawing: bool
    layers: Mapping[str, Pose]

    def to_json(self) -> dict[str, Any]:
        """Return the region as a JSON object."""
        layers = {layer_id: [list(row) for row in pose] for layer_id, pose in sorted(self.layers.items())}
        return {
            "region_id": self.region_id,
            "region": self.region.to_json(),
            "drawing": self.drawing,
            "layers": layers,
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Self:
        """Return the region that `to_json` wrote."""
        layers = {layer_id: pose_of(rows) for layer_id, rows in value["layers"].items()}
        return cls(
            value["region_id"], Region.from_json(value["region"], "#/region"), value["drawing"], layers
        )


@dataclass(frozen=True)
class MapState:
    """Hold everything that a revision's files are derived from."""

    reading: BaseReading | None
    recipe: Recipe
    layers: tuple[LayerState, ...] = ()
    erased: tuple[ErasedRegion, ...] = ()

    def layer(self, layer_id: str) -> LayerState | None:
        """Return the layer of this id, or None."""
        return next((layer for layer in self.layers if layer.layer_id == layer_id), None)


@dataclass(frozen=True)
class Difference:
    """Hold one thing in which two states differ.

    Parameters
    ----------
    subject : str
        `drawing`, `recipe.<field>`, `layer.<layer_id>`, `scan.<scan_id>`, `order` (of the layers that both
        have) or `region.<region_id>`.
    change : str
        `set`, `added`, `removed`, `moved`, `replaced`, `hidden`, `shown`, `renamed`, `cut`, `reordered`,
        `erased`, `restored`.
    message : str
        A sentence.
    before, after : dict or None
        What it was, and what it is.
    """

    subject: str
    change: str
    message: str
    before: dict[str, Any] | None = None
    after: dict[str, Any] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the difference as a JSON object."""
        return {
            "subject": self.subject,
            "change": self.change,
            "message": self.message,
            "before": self.before,
            "after": self.after,
        }


def differences(before: MapState, after: MapState) -> list[Difference]:
    """Return in what two states differ: the drawing, the recipe, then layers in their order, then regions."""
    found: list[Difference] = []
    if before.reading != after.reading:
        found.append(_drawing_difference(before.reading, after.reading))
    old, new = before.recipe.to_json(), after.recipe.to_json()
    found += [
        Difference(
            f"recipe.{name}",
            "set",
            f"The recipe's {name} goes from {old[name]} to {new[name]}.",
            {name: old[name]},
            {name: new[name]},
        )
        for name in new
        if old[name] != new[name]
    ]
    for layer in before.layers:
        found += _layer_differences(layer, after.layer(layer.layer_id))
    for layer in after.layers:
        if before.layer(layer.layer_id) is None:
            found += _added(layer)
    return found + _order_difference(before, after) + _region_differences(before, after)


def subjects(found: list[Difference]) -> set[str]:
    """Return what a list of differences is about."""
    return {one.subject for one in found}


def pose_of(rows: Any) -> Pose:
    """Return a pose from four rows of four numbers."""
    return tuple(tuple(float(value) for value in row) for row in rows)


def moved_by(before: Pose, after: Pose) -> tuple[float, float]:
    """Return how far apart two poses of a scan are: metres at the scan's origin, and radians."""
    return Transform.of(before).distance_to(Transform.of(after))


def _drawing_difference(before: BaseReading | None, after: BaseReading | None) -> Difference:
    old, new = (None if r is None else {"drawing_id": r.drawing_id, "walls_sha256": r.walls_sha256}
                for r in (before, after))  # fmt: skip
    same = before is not None and after is not None and before.drawing_id == after.drawing_id
    told = "The drawing was read anew." if same else "Another drawing lies underneath."
    return Difference(DRAWING, "set", told, old, new)


def _layer_differences(old: LayerState, new: LayerState | None) -> list[Difference]:
    subject, shown = f"layer.{old.layer_id}", _shown(old)
    if new is None:
        return [
            Difference(subject, "removed", f"The layer {old.name!r} was removed.", shown, None),
            Difference(f"scan.{old.scan_id}", "removed", f"The scan of {old.name!r} was taken off."),
        ]
    found = []
    if new.placement_id != old.placement_id:
        told = f"The layer {old.name!r} holds another placement."
        found.append(Difference(subject, "replaced", told, shown, _shown(new)))
        found += [
            Difference(f"scan.{scan_id}", change, told)
            for scan_id, change in ((old.scan_id, "removed"), (new.scan_id, "added"))
            if old.scan_id != new.scan_id
        ]
    elif new.T_map_scan != old.T_map_scan:
        metres, radians = moved_by(old.T_map_scan, new.T_map_scan)
        told = f"The layer {old.name!r} was moved by {metres:.3f} m and {math.degrees(radians):.2f} degrees."
        found.append(Difference(subject, "moved", told, shown, _shown(new)))
    if new.visible != old.visible:
        change = "shown" if new.visible else "hidden"
        found.append(Difference(subject, change, f"The layer {old.name!r} was {change}.", shown, _shown(new)))
    if new.name != old.name:
        told = f"The layer {old.name!r} is called {new.name!r}."
        found.append(Difference(subject, "renamed", told, shown, _shown(new)))
    if new.part != old.part and new.placement_id == old.placement_id:
        told = f"The layer {old.name!r} holds another part of its scan."
        found.append(Difference(subject, "cut", told, shown, _shown(new)))
    return found


def _added(layer: LayerState) -> list[Difference]:
    told = f"The layer {layer.name!r} was added."
    return [
        Difference(f"layer.{layer.layer_id}", "added", told, None, _shown(layer)),
        Difference(f"scan.{layer.scan_id}", "added", f"The scan of {layer.name!r} was added."),
    ]


def _order_difference(before: MapState, after: MapState) -> list[Difference]:
    old = [one.layer_id for one in before.layers if after.layer(one.layer_id) is not None]
    new = [one.layer_id for one in after.layers if before.layer(one.layer_id) is not None]
    told = "The layers are in another order."
    return [] if old == new else [Difference(ORDER, "reordered", told, {"layers": old}, {"layers": new})]


def _region_differences(before: MapState, after: MapState) -> list[Difference]:
    old = {one.region_id: one for one in before.erased}
    new = {one.region_id: one for one in after.erased}
    gone = [
        Difference(f"region.{key}", "restored", "An erased region was restored.", one.to_json(), None)
        for key, one in old.items()
        if key not in new
    ]
    come = [
        Difference(f"region.{key}", "erased", "A region was erased.", None, one.to_json())
        for key, one in new.items()
        if key not in old
    ]
    return gone + come


def _shown(layer: LayerState) -> dict[str, Any]:
    return {
        "layer_id": layer.layer_id,
        "name": layer.name,
        "scan_id": layer.scan_id,
        "placement_id": layer.placement_id,
        "part": layer.part,
        "T_map_scan": [list(row) for row in layer.T_map_scan],
        "visible": layer.visible,
    }
