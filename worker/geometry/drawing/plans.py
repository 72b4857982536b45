"""Several plans on one sheet: groups of walls that stand apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from service.domain.findings import Finding
from worker.geometry.drawing.file_frame import FileFrame
from worker.geometry.drawing.reading import Reading

_APART = 3.0
_LEAST_SIDE = 3.0
_LEAST_SHARE = 0.2
_MOST = 50
_ASSUMED_EXTENT = 30.0


def several_plans(reading: Reading) -> Finding | None:
    """Return the finding ``several-plans`` where the walls fall into groups that could each be a building.

    Groups stand at least 3 m apart, their boxes do not overlap, and each has at least a fifth of the largest
    one's walls. Buildings that really stand apart on a site plan are found too: a person decides. The
    `within` of each is a polygon in the file's own coordinates, ready for an edit that includes it.
    """
    if len(reading.walls) < 2:
        return None
    metres = 1.0 if reading.unit == "m" else _ASSUMED_EXTENT / max(*reading.sheet, 1e-9)
    shapes = np.array([shapely.LineString(w.centre) for w in reading.walls])
    grown = shapely.union_all(shapely.buffer(shapes, _APART / 2 / metres, quad_segs=2))
    groups = shapely.get_parts(grown)
    tree = shapely.STRtree(groups)
    walls, group = tree.query(
        shapely.line_interpolate_point(shapes, 0.5, normalized=True), predicate="within"
    )
    length = np.bincount(group, weights=shapely.length(shapes)[walls], minlength=len(groups))
    boxes = [
        shapely.box(*shapely.total_bounds(shapes[walls[group == g]]))
        for g in np.flatnonzero(length >= _LEAST_SHARE * length.max())
    ]
    boxes = [box for box in boxes if _sides(box) >= _LEAST_SIDE / metres]
    alone = [b for b in boxes if not any(b is not o and b.intersects(o) for o in boxes)]
    if len(alone) < 2:
        return None
    frame = FileFrame.of(reading)
    return Finding(
        "several-plans",
        "warning",
        f"The walls stand in {len(alone)} groups apart from each other: if the sheet shows several plans, "
        "include one of them by an edit.",
        {"plans": [{"within": _corners(box, frame)} for box in alone[:_MOST]]},
    )


def _sides(box: Any) -> float:
    x0, y0, x1, y1 = box.bounds
    return float(min(x1 - x0, y1 - y0))


def _corners(box: Any, frame: FileFrame) -> list[list[float]]:
    x0, y0, x1, y1 = box.buffer(0.02 * _sides(box)).bounds
    ring = frame.to_file(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]))
    return [[round(float(x), 4), round(float(y), 4)] for x, y in ring]
