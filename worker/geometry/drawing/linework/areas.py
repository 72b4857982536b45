"""The area that a filled entity covers: a solid hatch is one entity of many rings."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from worker.geometry.drawing.linework.linework import Linework


def entity_area(linework: Linework, entity: int, unit: float) -> Any | None:
    """Return the area of a filled entity [m], holes left out, or None where it has none."""
    low, high = np.searchsorted(linework.entity, [entity, entity + 1])
    ends = linework.ends[low:high] * unit
    if len(ends) < 3:
        return None
    breaks = np.flatnonzero(np.abs(ends[1:, 0] - ends[:-1, 1]).max(axis=1) > 1e-6) + 1
    rings = [np.vstack([part[:, 0], part[-1:, 1]]) for part in np.split(ends, breaks) if len(part) >= 2]
    if len(rings) == 1:
        area = shapely.make_valid(shapely.polygons(np.vstack([rings[0], rings[0][:1]])))
    else:
        closed = [shapely.linestrings(np.vstack([r, r[:1]])) for r in rings]
        area = shapely.build_area(shapely.union_all(closed))
    parts = [p for p in shapely.get_parts(area) if p.geom_type in {"Polygon", "MultiPolygon"} and p.area > 0]
    return shapely.union_all(parts) if parts else None
