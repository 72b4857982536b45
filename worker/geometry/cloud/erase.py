"""Take erased regions off walls and points: what stood there is no longer in the map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from service.domain.region import Region
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.cloud.within import within
from worker.geometry.drawing.reading.reading import Column, Wall

_SHORTEST = 0.01


def without(cloud: PointCloud, regions: Iterable[Region]) -> PointCloud:
    """Return the cloud's points that lie in none of the regions, all in frame `map` [m]."""
    kept = np.ones(len(cloud), dtype=np.bool_)
    for region in regions:
        kept &= ~within(region, cloud.points)
    return PointCloud(cloud.points[kept], cloud.labels[kept])


def from_floor_to_top(regions: Iterable[Region], wall_height: float) -> list[Region]:
    """Return the regions that hold a wall over its whole height [m]: those in which it no longer stands."""
    return [
        region
        for region in regions
        if (region.z_min_m is None or region.z_min_m <= 0.0)
        and (region.z_max_m is None or region.z_max_m > wall_height)
    ]


def cut_walls(walls: Sequence[Wall], regions: Sequence[Region]) -> tuple[Wall, ...]:
    """Return what is left of walls where regions are cut out of them, in frame `map`.

    The centre line decides; both faces are cut at the same places along the wall. Pieces under 1 cm go.
    """
    left = list(walls)
    for region in regions:
        left = [piece for wall in left for piece in _pieces(wall, region)]
    return tuple(left)


def cut_columns(columns: Sequence[Column], regions: Sequence[Region]) -> tuple[Column, ...]:
    """Return the columns whose middle lies in none of the regions."""
    return tuple(c for c in columns if not _held(c.outline.mean(axis=0)[None], regions)[0])


def held_flat(points: NDArray[np.float64], regions: Sequence[Region]) -> NDArray[np.bool_]:
    """Return which (N, 2) points lie in one of the regions, whatever their heights."""
    return _held(points, regions)


def _held(points: NDArray[np.float64], regions: Sequence[Region]) -> NDArray[np.bool_]:
    held = np.zeros(len(points), dtype=np.bool_)
    raised = np.column_stack([points, np.zeros(len(points))])
    for region in regions:
        held |= within(replace(region, z_min_m=None, z_max_m=None), raised)
    return held


def _pieces(wall: Wall, region: Region) -> list[Wall]:
    """Return the pieces of a wall outside one region; the wall itself where they do not meet."""
    at = _crossings(wall.centre, np.array(region.within))
    middles = _along(wall.centre, (at[:-1] + at[1:]) / 2)
    outside = ~_held(middles, [region])
    if outside.all():
        return [wall]
    spans = _joined([(a, b) for a, b, kept in zip(at[:-1], at[1:], outside, strict=True) if kept])
    pieces = [_between(wall, a, b) for a, b in spans]
    return [piece for piece in pieces if piece.length >= _SHORTEST]


def _joined(spans: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    joined: list[tuple[float, float]] = []
    for a, b in spans:
        if joined and joined[-1][1] == a:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return joined


def _crossings(line: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where a polyline meets a polygon's edges, both ends included, as shares of its length."""
    lengths = np.hypot(*np.diff(line, axis=0).T)
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    total = begins[-1]
    met = [0.0, 1.0]
    for p, q, begin, length in zip(line[:-1], line[1:], begins[:-1], lengths, strict=True):
        d = q - p
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            e = b - a
            cross = d[0] * e[1] - d[1] * e[0]
            if cross != 0.0:
                t = ((a[0] - p[0]) * e[1] - (a[1] - p[1]) * e[0]) / cross
                u = ((a[0] - p[0]) * d[1] - (a[1] - p[1]) * d[0]) / cross
                if 0.0 <= t <= 1.0 and 0.0 <= u <= 1.0:
                    met.append((begin + t * length) / total)
    return np.unique(met)


def _along(line: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, 2) points at shares of a polyline's length."""
    begins = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at = shares * begins[-1]
    return np.column_stack([np.interp(at, begins, line[:, k]) for k in (0, 1)])


def _between(wall: Wall, a: float, b: float) -> Wall:
    """Return the part of a wall between two shares of its length."""
    faces = (_part(wall.faces[0], a, b), _part(wall.faces[1], a, b))
    return replace(wall, centre=_part(wall.centre, a, b), faces=faces)


def _part(line: NDArray[np.float64], a: float, b: float) -> NDArray[np.float64]:
    begins = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    shares = begins / begins[-1]
    ends = _along(line, np.array([a, b]))
    return np.vstack([ends[:1], line[(shares > a) & (shares < b)], ends[1:]])
