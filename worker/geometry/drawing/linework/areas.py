"""The area that a filled entity covers: a solid hatch is one entity of many rings."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.linework.linework import Linework

_FEW, _AT_ONCE = 64, 128
_MOST_OF_ONE, _MOST_OF_SEVERAL = 4.0, 16.0
"""So often a side meets others: itself and its neighbours are 3, and squares of a raster meet 13 times."""


def entity_area(linework: Linework, entity: int, unit: float) -> Any | None:
    """Return the area of a filled entity [m], holes left out, or None where it has none.

    An outline that crosses itself over and over has none: N sides that all cross would make N^2 pieces, and
    no wall is drawn so.
    """
    low, high = np.searchsorted(linework.entity, [entity, entity + 1])
    ends = linework.ends[low:high] * unit
    if len(ends) < 3:
        return None
    breaks = np.flatnonzero(np.abs(ends[1:, 0] - ends[:-1, 1]).max(axis=1) > 1e-6) + 1
    rings = [np.vstack([part[:, 0], part[-1:, 1]]) for part in np.split(ends, breaks) if len(part) >= 2]
    if _is_tangled(ends, most=_MOST_OF_ONE if len(rings) == 1 else _MOST_OF_SEVERAL):
        return None
    if len(rings) == 1:
        area = shapely.make_valid(shapely.polygons(np.vstack([rings[0], rings[0][:1]])))
    else:
        closed = [shapely.linestrings(np.vstack([r, r[:1]])) for r in rings]
        area = shapely.build_area(shapely.union_all(closed))
    parts = [p for p in shapely.get_parts(area) if p.geom_type in {"Polygon", "MultiPolygon"} and p.area > 0]
    return shapely.union_all(parts) if parts else None


def _is_tangled(ends: NDArray[np.float64], *, most: float) -> bool:
    """Return whether (N, 2, 2) sides meet each other much oftener than those of an outline do."""
    if len(ends) < _FEW:
        return False
    sides = shapely.linestrings(ends)
    tree = shapely.STRtree(sides)
    count = 0
    for first in range(0, len(sides), _AT_ONCE):
        count += len(tree.query(sides[first : first + _AT_ONCE], predicate="intersects")[0])
        if count > most * len(ends):
            return True
    return False
