"""What a person may say about a scan's file: which way is up, and what its numbers count."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from service.domain.errors import InvalidRequest
from service.domain.rough_pose import RoughPose

UP_AXES = ("x", "y", "z", "-x", "-y", "-z")
"""The directions that can be up, in the file's own axes."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
"""Metres per unit, by the unit's name."""


@dataclass(frozen=True)
class ScanOptions:
    """Hold what is given about a scan; what is None is found from the file.

    Parameters
    ----------
    up : str, optional
        One of `UP_AXES`.
    metres_per_unit : float, optional
        Metres that one unit of the file's coordinates counts.

    Raises
    ------
    InvalidRequest
        If the axis is none of the six, or the unit lies outside 1e-6 to 1e4 metres.
    """

    up: str | None = None
    metres_per_unit: float | None = None

    def __post_init__(self) -> None:
        if self.up is not None and self.up not in UP_AXES:
            detail = f"The scan's up axis is {str(self.up)[:20]!r}; it has to be one of {', '.join(UP_AXES)}."
            raise InvalidRequest(detail, errors=[{"pointer": "#/up", "detail": detail}])
        if self.metres_per_unit is not None and not 1e-6 <= self.metres_per_unit <= 1e4:
            raise InvalidRequest(
                f"The scan's unit is {self.metres_per_unit} m; it has to lie between 0.000001 and 10000 m."
            )

    @classmethod
    def of(cls, up: str | None = None, unit: str | None = None) -> Self:
        """Return the options for an axis and the name of a unit.

        Raises
        ------
        InvalidRequest
            If either is not known.

        Examples
        --------
        >>> ScanOptions.of("y", "mm").metres_per_unit
        0.001
        """
        if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
            detail = f"The scan's unit is {str(unit)[:20]!r}; it has to be one of {', '.join(UNITS)}."
            raise InvalidRequest(detail, errors=[{"pointer": "#/unit", "detail": detail}])
        return cls(up, None if unit is None else UNITS[unit])

    def to_json(self) -> dict[str, Any]:
        """Return the options as a JSON object."""
        return {"up": self.up, "metres_per_unit": self.metres_per_unit}

    @classmethod
    def from_json(cls, value: Mapping[str, Any] | None) -> Self:
        """Return the options that `to_json` wrote; nothing said where there are none."""
        return cls() if value is None else cls(**value)


@dataclass(frozen=True)
class SaidOfScan:
    """Hold what a sender says of a scan beside its bytes: where it was taken, and how its file is meant."""

    rough_pose: RoughPose | None = None
    options: ScanOptions = field(default_factory=ScanOptions)

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Self:
        """Return what ``rough_pose``, ``up`` and ``unit`` of a JSON object say; each may be left out.

        Raises
        ------
        InvalidRequest
            If one is wrong, or there is another; the place is named.
        """
        unknown = set(value) - {"rough_pose", "up", "unit"}
        if unknown:
            detail = f"A scan has no field {min(unknown)!r}; those it has are rough_pose, up and unit."
            raise InvalidRequest(detail, errors=[{"pointer": f"#/{min(unknown)}", "detail": detail}])
        pose = value.get("rough_pose")
        options = ScanOptions.of(value.get("up") or None, value.get("unit") or None)
        return cls(None if pose is None else RoughPose.from_json(pose), options)
