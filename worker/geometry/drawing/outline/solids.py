"""Walls from the outlines of solid material: a cut through a building model, filled areas of a drawing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.outline.strips import End, Strip, find_strips
from worker.geometry.drawing.reading.reading import Column, Wall

MAX_THICKNESS = 1.2
"""Two faces farther apart than this [m] are not taken for one wall."""

_JOINT = 0.003
_SMOOTH = 0.002
_LEAST_AREA = 0.002
_PIER_SIDE, _PIER_RATIO, _PIER_FILL = 2.5, 2.0, 0.6
_LEAST_FACE = 0.3


@dataclass(frozen=True, eq=False)
class Solids:
    """Hold what solid outlines were read as.

    Parameters
    ----------
    walls : tuple of Wall
        Strips with two faces, and faces whose other side is too far away to make a wall (thickness 0).
    columns : tuple of Column
        Free-standing compact outlines.
    """

    walls: tuple[Wall, ...]
    columns: tuple[Column, ...]


def read_outlines(areas: Iterable[Any], *, max_thickness: float = MAX_THICKNESS) -> Solids:
    """Return the walls and columns of solid areas: exact faces, thickness and centre lines.

    Areas that touch or overlap are one body, so that faces inside it vanish: at a corner or a junction a
    wall's face ends where one sees it end. A centre line runs on to the middle of the wall that it meets at a
    corner.

    Parameters
    ----------
    areas : iterable of shapely Polygon or MultiPolygon
        Solid material in plan [m], valid.
    max_thickness : float
        The thickest wall [m]; the faces of thicker bodies become walls of thickness 0.

    Returns
    -------
    Solids
        In the areas' frame.

    Raises
    ------
    DrawingTooComplex
        If the edges lie too densely to be compared.

    Notes
    -----
    About O(n log n) in the number n of edges, by a tree of boxes.
    """
    walls: list[Wall] = []
    columns: list[Column] = []
    for body in bodies(areas):
        if _is_pier(body):
            columns.append(Column(np.asarray(body.exterior.coords)[:-1, :2].copy()))
            continue
        strips, rest = find_strips(rings_of(body), body, max_thickness=max_thickness)
        walls += [_wall(s) for s in strips]
        walls += [Wall(line, 0.0, (line, line)) for line in _faces_alone(rest, strips)]
    return Solids(tuple(walls), tuple(columns))


def bodies(areas: Iterable[Any]) -> list[Any]:
    """Return the connected bodies of areas, as oriented polygons; joints of up to 6 mm are closed."""
    grown = [shapely.buffer(a, _JOINT, join_style="mitre", mitre_limit=2.0) for a in areas if a.area > 0]
    if not grown:
        return []
    shrunk = shapely.buffer(shapely.union_all(grown), -_JOINT, join_style="mitre", mitre_limit=2.0)
    parts = shapely.get_parts(shapely.make_valid(shapely.simplify(shrunk, _SMOOTH, preserve_topology=False)))
    solid = [p for p in parts if p.geom_type == "Polygon" and p.area >= _LEAST_AREA]
    return [shapely.geometry.polygon.orient(p) for p in solid]


def rings_of(body: Any) -> list[NDArray[np.float64]]:
    """Return the outer ring and the holes of a polygon as (K, 2) points, not closed, material to the left."""
    rings = [body.exterior, *body.interiors]
    return [np.asarray(ring.coords, dtype=np.float64)[:-1, :2].copy() for ring in rings]


def _is_pier(body: Any) -> bool:
    """Return whether a body is free-standing and compact: its longer side less than twice the shorter."""
    box = shapely.minimum_rotated_rectangle(body)
    if box.geom_type != "Polygon" or len(body.interiors) > 0:
        return False
    corners = np.asarray(box.exterior.coords)[:3, :2]
    short, long = sorted(np.hypot(*np.diff(corners, axis=0).T))
    return bool(long <= _PIER_SIDE and long < _PIER_RATIO * short and body.area > _PIER_FILL * box.area)


def _wall(strip: Strip) -> Wall:
    """Return a strip as a wall whose faces run on over outer corners and its centre line to their middle."""
    right = _extended(strip.right, strip.start.right, strip.end.right)
    left = _extended(strip.left, strip.start.left, strip.end.left)
    centre = _extended(strip.centre, _half(strip.start), _half(strip.end))
    return Wall(centre, strip.thickness, (left, right))


def _half(end: End) -> float:
    """Return how far a centre line runs on: half an outer corner, all of a share of a junction."""
    return max(end.right * end.centre_share, end.left * end.centre_share)


def _extended(line: NDArray[np.float64], before: float, after: float) -> NDArray[np.float64]:
    out = line.copy()
    for at, towards, by in ((0, 1, before), (-1, -2, after)):
        step = line[at] - line[towards]
        out[at] = line[at] + step / max(float(np.hypot(*step)), 1e-9) * by
    return out


def _faces_alone(lines: Iterable[NDArray[np.float64]], strips: list[Strip]) -> list[NDArray[np.float64]]:
    """Return the faces that belong to no strip and are no mere end of one, in one piece where they meet."""
    caps = [shapely.LineString(c) for s in strips for c in (s.cap_start, s.cap_end)]
    tree = shapely.STRtree(caps) if caps else None
    out = []
    for line in lines:
        length = float(np.hypot(*np.diff(line, axis=0).T).sum())
        if length < _LEAST_FACE:
            continue
        middle = shapely.LineString(line).interpolate(0.5, normalized=True)
        near = tree.query(middle, predicate="dwithin", distance=0.02) if tree is not None else []
        if not any(length <= caps[i].length + 0.03 for i in near):
            out.append(line)
    return out
