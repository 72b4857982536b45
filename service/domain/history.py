"""What was done to make a revision, as its history keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from service.domain.layer_part import LayerPart
from service.domain.measured import as_json
from service.domain.recipe import MapFromDrawing
from service.domain.region import Region

Op = Literal[
    "add-layer",
    "move-layer",
    "replace-layer",
    "hide-layer",
    "show-layer",
    "rename-layer",
    "cut-layer",
    "remove-layer",
    "set-layers",
    "erase-region",
    "restore-region",
    "set-recipe",
    "set-drawing",
]


@dataclass(frozen=True)
class Shift:
    """Hold how far a layer was moved along the map's axes [m], and turned about its scan's origin [rad]."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float


@dataclass(frozen=True)
class DoneOperation:
    """Hold one operation that was done to a revision's parent; `op` tells which, and what it has.

    Parameters
    ----------
    op : str
        As a request names it; ``set-layers`` named all of them at once, in their order.
    layer_id, placement_id, name, region_id, drawing_id : str, optional
        What it was done to, or what was put there.
    layer_ids : tuple of str, optional
        Of ``set-layers``.
    T_map_scan : tuple of 4 rows of 4 numbers, optional
        Where a layer was moved to.
    by : Shift, optional
        Or by how much it was moved.
    part : LayerPart, optional
        Which of its scan's points a layer holds since.
    region : Region, optional
        What was erased.
    recipe : mapping, optional
        The fields of the recipe that were set.
    """

    op: Op
    layer_id: str | None = None
    placement_id: str | None = None
    name: str | None = None
    layer_ids: tuple[str, ...] | None = None
    T_map_scan: tuple[tuple[float, ...], ...] | None = None
    by: Shift | None = None
    part: LayerPart | None = None
    region_id: str | None = None
    region: Region | None = None
    recipe: Mapping[str, float | bool | MapFromDrawing] | None = None
    drawing_id: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the operation as a JSON object, with what it has."""
        return {name: as_json(value) for name, value in vars(self).items() if value is not None}
