"""A piece of a map seen from above, between two heights: what is erased from it, or taken of a scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from service.domain.errors import InvalidRequest

MAX_REGIONS = 200
MAX_VERTICES = 500
_FARTHEST = 1e6
_FIELDS = ("within", "z_min_m", "z_max_m")


@dataclass(frozen=True)
class Region:
    """Hold a polygon in frame `map`, and the heights between which it counts.

    Parameters
    ----------
    within : tuple of points
        Its corners [m]; the polygon is closed by itself, and where it crosses itself the even-odd rule holds.
    z_min_m, z_max_m : float or None
        Lower and upper end [m]; None for no end.
    """

    within: tuple[tuple[float, float], ...]
    z_min_m: float | None = None
    z_max_m: float | None = None

    @classmethod
    def from_json(cls, value: object, pointer: str) -> Self:
        """Return a region from a JSON object.

        Raises
        ------
        InvalidRequest
            If it is none; the place is named.
        """
        if not isinstance(value, Mapping) or set(value) - set(_FIELDS):
            raise _invalid(pointer, f"A region is an object with {', '.join(_FIELDS)}.")
        corners = value.get("within")
        if (
            not isinstance(corners, Sequence)
            or isinstance(corners, str)
            or not 3 <= len(corners) <= MAX_VERTICES
        ):
            raise _invalid(f"{pointer}/within", f"A polygon has 3 to {MAX_VERTICES} corners [x, y].")
        within = tuple(_corner(one, f"{pointer}/within/{k}") for k, one in enumerate(corners))
        low, high = (
            None if value.get(name) is None else _number(value[name], f"{pointer}/{name}")
            for name in _FIELDS[1:]
        )
        if low is not None and high is not None and not low < high:
            raise _invalid(
                f"{pointer}/z_max_m", f"The upper end, {high:g} m, is not above the lower, {low:g} m."
            )
        return cls(within, low, high)

    def to_json(self) -> dict[str, Any]:
        """Return the region as `from_json` takes it."""
        heights = {"z_min_m": self.z_min_m, "z_max_m": self.z_max_m}
        return {"within": [list(p) for p in self.within]} | {
            k: v for k, v in heights.items() if v is not None
        }


def regions_of(value: object, pointer: str) -> tuple[Region, ...]:
    """Return the regions of a JSON list.

    Raises
    ------
    InvalidRequest
        If it is no list of regions, or too long a one.
    """
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) > MAX_REGIONS:
        raise _invalid(pointer, f"This is a list of at most {MAX_REGIONS} regions.")
    return tuple(Region.from_json(one, f"{pointer}/{k}") for k, one in enumerate(value))


def _corner(value: object, pointer: str) -> tuple[float, float]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise _invalid(pointer, "A corner is a list of two numbers, x and y.")
    return _number(value[0], f"{pointer}/0"), _number(value[1], f"{pointer}/1")


def _number(value: object, pointer: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= _FARTHEST:
        raise _invalid(pointer, f"{str(value)[:40]} is no number of metres below a million.")
    return float(value)


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
