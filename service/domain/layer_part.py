"""Which points of a placed scan a layer holds: the target, and what a person adds to it or takes off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from service.domain.errors import InvalidRequest
from service.domain.region import Region, regions_of

TARGET, REFERENCE, OUTLIER = 0, 1, 2
"""Labels of a placed scan's points: not explained by the map, explained by it, standing alone."""
_FIELDS = ("points", "include", "exclude")


@dataclass(frozen=True)
class LayerPart:
    """Hold which points of a placed scan are compounded into the map.

    Parameters
    ----------
    points : {"target", "all"}
        What the map does not explain, or everything.
    include, exclude : tuple of Region
        Where reference points are taken too, and where nothing is, which comes last.
    """

    points: Literal["target", "all"] = "target"
    include: tuple[Region, ...] = ()
    exclude: tuple[Region, ...] = ()

    @classmethod
    def from_json(cls, value: object, pointer: str = "#/part") -> Self:
        """Return a part from a JSON object.

        Raises
        ------
        InvalidRequest
            If it is none; the place is named.
        """
        if not isinstance(value, Mapping) or set(value) - set(_FIELDS):
            raise _invalid(pointer, f"A part is an object with {', '.join(_FIELDS)}.")
        points = value.get("points", "target")
        if points not in ("target", "all"):
            raise _invalid(f"{pointer}/points", "The points of a layer are those of the 'target', or 'all'.")
        include, exclude = (regions_of(value.get(name, ()), f"{pointer}/{name}") for name in _FIELDS[1:])
        return cls(points, include, exclude)

    def to_json(self) -> dict[str, Any]:
        """Return the part as `from_json` takes it, complete."""
        regions = {name: [r.to_json() for r in getattr(self, name)] for name in _FIELDS[1:]}
        return {"points": self.points, **regions}


WHOLE = LayerPart("all")
"""The part of a layer that was made before layers had parts."""


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
