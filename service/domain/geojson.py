"""A place as GeoJSON has it (RFC 7946), in one of our frames instead of longitude and latitude."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Self

from service.domain.measured import as_json

Position = tuple[float, ...]
"""Two coordinates, or three."""


@dataclass(frozen=True)
class Geometry:
    """Hold a geometry; which frame its coordinates are in is told where it stands.

    Parameters
    ----------
    type : str
        GeoJSON's name of the kind.
    coordinates : nested tuples of float
        As RFC 7946, section 3.1, nests them for the kind.
    """

    type: Literal["Point", "MultiPoint", "LineString", "MultiLineString", "Polygon", "MultiPolygon"]
    coordinates: (
        Position
        | tuple[Position, ...]
        | tuple[tuple[Position, ...], ...]
        | tuple[tuple[tuple[Position, ...], ...], ...]
    )

    @classmethod
    def polygons(cls, rings: Iterable[Sequence[Sequence[float]]]) -> Self:
        """Return polygons without holes, of rings whose end may be left open."""
        closed = [tuple(tuple(float(v) for v in point) for point in ring) for ring in rings]
        return cls(
            "MultiPolygon", tuple(((*ring, ring[0]) if ring[0] != ring[-1] else ring,) for ring in closed)
        )

    def to_json(self) -> dict[str, Any]:
        """Return the geometry as GeoJSON."""
        return {"type": self.type, "coordinates": as_json(self.coordinates)}
