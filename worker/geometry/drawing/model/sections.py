"""Areas of the rings in which a cut meets solid bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

_LEAST_AREA = 1e-6


def signed_area(ring: NDArray[np.float64]) -> float:
    """Return the area of a (K, 2) ring [m^2], positive where it runs counter-clockwise."""
    centred = ring - ring.mean(axis=0)
    x, y = centred.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0


def area_of(rings: Sequence[NDArray[np.float64]]) -> Any:
    """Return the area that rings enclose, as a shapely geometry.

    Rings that run as the largest one does hold material, the others are holes: so bodies of one element may
    overlap.

    Parameters
    ----------
    rings : sequence of ndarrays of shape (K, 2), float64
        Not closed [m].
    """
    areas = [signed_area(ring) for ring in rings]
    kept = [(r, a) for r, a in zip(rings, areas, strict=True) if abs(a) > _LEAST_AREA and len(r) >= 3]
    if not kept:
        return shapely.Polygon()
    largest = max((a for _, a in kept), key=abs)
    solid = [_polygon(r) for r, a in kept if a * largest > 0]
    holes = [_polygon(r) for r, a in kept if a * largest < 0]
    material = shapely.union_all(solid)
    return shapely.difference(material, shapely.union_all(holes)) if holes else material


def _polygon(ring: NDArray[np.float64]) -> Any:
    return shapely.make_valid(shapely.Polygon(ring), method="structure")
