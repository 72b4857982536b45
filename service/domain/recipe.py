"""How a map is built from a drawing's walls and placed scans (paper, section 2.2)."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Self

from service.domain.errors import InvalidRequest

_LIMITS = {
    "voxel_size_m": (0.005, 5.0),
    "wall_height_m": (0.1, 100.0),
    "layer_voxel_size_m": (0.005, 5.0),
    "occupancy_resolution_m": (0.01, 1.0),
}


@dataclass(frozen=True)
class MapFromDrawing:
    """Hold `T_map_drawing`: where the drawing's origin lies in the map [m], and how it is turned [rad]."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0


@dataclass(frozen=True)
class Recipe:
    """Hold the parameters of a build.

    Parameters
    ----------
    voxel_size_m : float
        Edge of the voxel grid filter on what the drawing gives [m]; the paper found 0.4 best.
    wall_height_m : float
        Height to which walls are stacked [m].
    floor, ceiling : bool
        Whether planes at z = 0 and at the wall height are added (paper, section 4.4).
    layer_voxel_size_m : float
        Voxel edge of compounded scans [m]: dense whatever the drawing's voxel size.
    occupancy_resolution_m : float
        Edge of a cell of the occupancy grid [m].
    map_from_drawing : MapFromDrawing
        `T_map_drawing`.
    """

    voxel_size_m: float = 0.4
    wall_height_m: float = 2.5
    floor: bool = False
    ceiling: bool = False
    layer_voxel_size_m: float = 0.05
    occupancy_resolution_m: float = 0.05
    map_from_drawing: MapFromDrawing = MapFromDrawing()

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if not (isinstance(value, int | float) and math.isfinite(value) and low <= value <= high):
                detail = f"{name} is {value}; it has to lie between {low} and {high} m."
                raise InvalidRequest(detail, errors=[{"pointer": f"#/{name}", "detail": detail}])
        pose = self.map_from_drawing
        if not all(math.isfinite(v) and abs(v) < 1e6 for v in (pose.x_m, pose.y_m, pose.yaw_rad)):
            detail = "map_from_drawing has to hold three finite numbers: x_m, y_m, yaw_rad."
            raise InvalidRequest(detail, errors=[{"pointer": "#/map_from_drawing", "detail": detail}])

    def to_json(self) -> dict[str, Any]:
        """Return the recipe as a JSON object, complete with its defaults."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        """Return the recipe that `to_json` wrote, or one from fields that a user gave.

        Raises
        ------
        InvalidRequest
            If a field is unknown or out of its limits.
        """
        unknown = set(value) - set(cls.__dataclass_fields__)
        if unknown:
            detail = f"A recipe has no field {min(unknown)!r}."
            raise InvalidRequest(detail, errors=[{"pointer": f"#/{min(unknown)}", "detail": detail}])
        fields = dict(value)
        if isinstance(fields.get("map_from_drawing"), dict):
            fields["map_from_drawing"] = MapFromDrawing(**fields["map_from_drawing"])
        return cls(**fields)
