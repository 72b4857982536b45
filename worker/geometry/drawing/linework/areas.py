"""The area that a filled entity covers: a solid hatch is one entity of many rings."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.findings import Finding
from worker.geometry.drawing.linework.linework import Linework

_FEW = 64
"""An outline of fewer sides is never looked at: all of them crossing make no more than 2,000 pieces."""

_AT_ONCE = 128
"""So many sides are asked about at a time; it bounds memory alone, and changes no answer."""

_MOST_MEETINGS = 16.0
"""So often a side meets others [sides a side]: itself and its neighbours are 3, squares of a raster 13."""


def entity_area(linework: Linework, entity: int, unit: float) -> Any | None:
    """Return the area of a filled entity [m], holes left out, or None where it has none.

    An outline that crosses itself over and over has none (`tangled_areas` tells of it): N sides that all
    cross would make N^2 pieces.
    """
    low, high = np.searchsorted(linework.entity, [entity, entity + 1])
    ends = linework.ends[low:high] * unit
    if len(ends) < 3:
        return None
    breaks = np.flatnonzero(np.abs(ends[1:, 0] - ends[:-1, 1]).max(axis=1) > 1e-6) + 1
    rings = [np.vstack([part[:, 0], part[-1:, 1]]) for part in np.split(ends, breaks) if len(part) >= 2]
    if _is_tangled(ends, most=_MOST_MEETINGS):
        return None
    if len(rings) == 1:
        area = shapely.make_valid(shapely.polygons(np.vstack([rings[0], rings[0][:1]])))
    else:
        closed = [shapely.linestrings(np.vstack([r, r[:1]])) for r in rings]
        area = shapely.build_area(shapely.union_all(closed))
    parts = [p for p in shapely.get_parts(area) if p.geom_type in {"Polygon", "MultiPolygon"} and p.area > 0]
    return shapely.union_all(parts) if parts else None


def tangled_areas(linework: Linework) -> list[Finding]:
    """Return the finding that filled outlines cross themselves so often that they were taken for no area."""
    filled = np.flatnonzero(linework.filled & (linework.kind != "mask"))
    first = np.searchsorted(linework.entity, [filled, filled + 1]).T
    count = sum(_is_tangled(linework.ends[low:high], most=_MOST_MEETINGS) for low, high in first.tolist())
    if not count:
        return []
    message = (
        f"{count} filled outlines cross themselves over and over and were left out. Where walls are missing "
        "for it, draw them by edits, or export the drawing again with simple outlines."
    )
    return [Finding("areas-tangled", "warning", message, {"areas": count})]


def _is_tangled(ends: NDArray[np.float64], *, most: float) -> bool:
    """Return whether the distinct ones of (N, 2, 2) sides meet much oftener than those of an outline do."""
    if len(ends) < _FEW:
        return False
    turned = (ends[:, 0, 0] > ends[:, 1, 0]) | (
        (ends[:, 0, 0] == ends[:, 1, 0]) & (ends[:, 0, 1] > ends[:, 1, 1])
    )
    ends = np.unique(np.where(turned[:, None, None], ends[:, ::-1], ends), axis=0)
    sides = shapely.linestrings(ends)
    tree = shapely.STRtree(sides)
    count = 0
    for first in range(0, len(sides), _AT_ONCE):
        count += len(tree.query(sides[first : first + _AT_ONCE], predicate="intersects")[0])
        if count > most * len(ends):
            return True
    return False
