"""Walls and lines cut by a region: what lies inside it, and what outside."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import substring

from worker.geometry.drawing.reading.reading import Wall

_LEAST = 1e-6


def cut_line(line: NDArray[np.float64], region: Any, *, inside: bool) -> list[NDArray[np.float64]]:
    """Return the pieces of a (K, 2) line in the region, or outside of it, in the line's order."""
    whole = shapely.LineString(line)
    cut = whole.intersection(region) if inside else whole.difference(region)
    parts = shapely.get_parts(shapely.line_merge(cut) if cut.geom_type == "MultiLineString" else cut)
    pieces = [p for p in parts if p.geom_type == "LineString" and p.length > _LEAST]
    return [
        np.array(p.coords)[:, :2]
        for p in sorted(pieces, key=lambda p: whole.project(p.interpolate(0.5, normalized=True)))
    ]


def cut_wall(wall: Wall, region: Any) -> list[Wall]:
    """Return what of a wall lies outside of the region, its faces cut where the region's edge cuts them.

    The wall itself comes back, alone, where the region touches neither its centre line nor its faces.
    """
    faces = shapely.MultiLineString([wall.centre, *wall.faces])
    if not faces.intersects(region):
        return [wall]
    centres = cut_line(wall.centre, region, inside=False)
    left, right = (cut_line(face, region, inside=False) for face in wall.faces)
    if len(left) == len(right) == len(centres):
        found = list(zip(left, right, strict=True))
    else:
        found = [(_beside(wall.faces[0], c), _beside(wall.faces[1], c)) for c in centres]
    return [replace(wall, centre=centre, faces=pair) for centre, pair in zip(centres, found, strict=True)]


def share_inside(lines: tuple[NDArray[np.float64], ...], region: Any) -> float:
    """Return the share of the lines' length that lies in the region; of points, the share of their number."""
    shapes = shapely.MultiLineString([line for line in lines if len(line) > 1])
    if shapes.length > _LEAST:
        return float(shapes.intersection(region).length / shapes.length)
    points = shapely.points(np.vstack(lines))
    return float(np.mean(shapely.intersects(region, points)))


def _beside(face: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the stretch of a face that runs beside a piece of the centre line."""
    line = shapely.LineString(face)
    low, high = sorted(line.project(shapely.Point(end)) for end in (centre[0], centre[-1]))
    if high - low <= _LEAST:
        return centre
    return np.array(substring(line, low, high).coords)
