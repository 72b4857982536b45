"""Where a person thinks that a scan was taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from service.domain.errors import InvalidRequest
from service.domain.transform import Transform

_MAX_DISTANCE_M = 1e6


@dataclass(frozen=True)
class RoughPose:
    """Hold a rough `T_map_scan`: where the scan's origin lies in the map [m], and its turn about z [rad]."""

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_rad: float = 0.0

    def transform(self) -> Transform:
        """Return the pose as `T_map_scan`."""
        return Transform.from_xyz_yaw(self.x_m, self.y_m, self.z_m, self.yaw_rad)

    def to_json(self) -> dict[str, Any]:
        """Return the pose as a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: object, *, pointer: str = "#/rough_pose") -> Self:
        """Return the pose that a JSON object gives; x_m and y_m are needed, z_m and yaw_rad default to 0.

        Raises
        ------
        InvalidRequest
            If it is no such object, a field is unknown or missing, or a number is not finite.
        """
        if not isinstance(value, Mapping):
            raise _invalid(pointer, 'A rough pose is an object {"x_m", "y_m", "z_m", "yaw_rad"}.')
        for name in value:
            if name not in cls.__dataclass_fields__:
                raise _invalid(f"{pointer}/{name}", f"A rough pose has no field {name!r}.")
        for name in ("x_m", "y_m"):
            if name not in value:
                raise _invalid(f"{pointer}/{name}", f"The rough pose needs {name}.")
        numbers = {name: _number(found, f"{pointer}/{name}") for name, found in value.items()}
        return cls(**numbers)


def _number(value: object, pointer: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= _MAX_DISTANCE_M:
        raise _invalid(pointer, f"{value!r} is no finite number within {_MAX_DISTANCE_M:.0f}.")
    return float(value)


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
