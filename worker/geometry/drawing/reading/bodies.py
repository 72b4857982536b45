"""The material of walls and columns as areas, closed where walls meet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.reading.reading import Column, Wall

JOINT = 0.2
"""Widest gap between the ends of two walls that meet [m]: no opening that anybody passes is as narrow."""

_SLIT = 0.005
_SHARPEST = float(np.cos(np.radians(30.0)))
_MITRE = 2.0
_LEAST_AREA = 1e-6


def wall_body(wall: Wall) -> Any:
    """Return the area between a wall's faces; an empty one where it is a single line.

    Faces may have different numbers of points. Of a wall that runs round, each face a ring, the area lies
    between the two rings.
    """
    left, right = wall.faces
    if _is_ring(left) and _is_ring(right):
        return _area(left).symmetric_difference(_area(right))
    return _area(np.vstack([left, right[::-1]]))


def solid_of(walls: Sequence[Wall], columns: Sequence[Column] = ()) -> Any:
    """Return what is solid, in metres: bodies of walls and columns, and where walls meet.

    Many readings end each wall where another begins, and leave the block where they meet to none. It is what
    both walls would cover if they went on: the corner of two, or the piece under the end of a partition. What
    faces close in all around is solid, too, where it is no wider than one of the walls that it touches.
    """
    bodies = np.array([*(wall_body(w) for w in walls), *(_area(c.outline) for c in columns)])
    touching = shapely.union_all([*bodies, *_joints(walls)]).buffer(_SLIT, join_style="mitre")
    solid = touching.buffer(-_SLIT, join_style="mitre")
    drawn = shapely.get_parts(shapely.union_all([solid, *single_lines(walls)]).buffer(_SLIT))
    holes = np.array([shapely.Polygon(ring) for part in drawn for ring in part.interiors], dtype=object)
    width = np.full(len(holes), JOINT)
    hole, body = shapely.STRtree(bodies).query(holes, predicate="dwithin", distance=2.0 * _SLIT)
    thickness = np.array([w.thickness for w in walls] + [0.0] * len(columns))
    np.maximum.at(width, hole, thickness[body])
    narrow = shapely.is_empty(shapely.buffer(holes, -width / 2.0))
    return shapely.union_all([solid, *shapely.buffer(holes[narrow], 2.0 * _SLIT).tolist()])


def single_lines(walls: Sequence[Wall]) -> list[Any]:
    """Return the lines of walls that have no body: what is drawn as one line."""
    return [shapely.linestrings(w.centre) for w in walls if w.thickness <= 0.0]


def _joints(walls: Sequence[Wall]) -> Any:
    """Return what pairs of ends that meet would both cover if their walls went on, and the way there."""
    thick = [w for w in walls if w.thickness > 0.0]
    if not thick:
        return []
    edge = np.array([[w.faces[0][at], w.faces[1][at]] for w in thick for at in (0, -1)])
    onward = np.array([_unit(w.centre[at] - w.centre[n]) for w in thick for at, n in ((0, 1), (-1, -2))])
    wide = np.repeat([w.thickness for w in thick], 2)
    lines = shapely.linestrings(edge)
    one, other = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=JOINT)
    apart = (one < other) & ((onward[one] * onward[other]).sum(axis=1) <= _SHARPEST)
    one, other = one[apart], other[apart]
    by = (_MITRE * np.maximum(wide[one], wide[other]) + JOINT)[:, None, None]
    longer = [
        shapely.polygons(np.concatenate([edge[k], edge[k][:, ::-1] + by * onward[k][:, None]], axis=1))
        for k in (one, other)
    ]
    block = shapely.intersection(*longer)
    ways = [
        shapely.intersection(shapely.convex_hull(shapely.union(lines[k], block)), area)[
            ~shapely.is_empty(block)
        ]
        for k, area in zip((one, other), longer, strict=True)
    ]
    joints = np.concatenate([block, *ways])
    return joints[shapely.area(joints) > _LEAST_AREA]


def _unit(step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a vector's direction; of one without a length, nothing."""
    length = float(np.hypot(*step))
    return step / length if length else step


def _is_ring(line: NDArray[np.float64]) -> bool:
    return len(line) > 3 and bool(np.allclose(line[0], line[-1], rtol=0.0, atol=1e-6))


def _area(ring: NDArray[np.float64]) -> Any:
    """Return the area in a ring, also one that crosses itself; an empty one where it has none."""
    if len(ring) < 3:
        return shapely.Polygon()
    return shapely.make_valid(shapely.Polygon(ring), method="structure", keep_collapsed=False)
