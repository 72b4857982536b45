"""Which points lie in a region of a map, and which of a placed scan's points a layer takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.domain.layer_part import OUTLIER, TARGET, LayerPart
from service.domain.region import Region


def within(region: Region, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of (N, 3) points in frame `map` [m] lie in a region, its lower ends included."""
    corners = np.array(region.within)
    low, high = corners.min(axis=0), corners.max(axis=0)
    near = np.all((points[:, :2] >= low) & (points[:, :2] <= high), axis=1)
    if region.z_min_m is not None:
        near &= points[:, 2] >= region.z_min_m
    if region.z_max_m is not None:
        near &= points[:, 2] < region.z_max_m
    held = np.zeros(len(points), dtype=np.bool_)
    held[near] = _inside(points[near, :2], corners)
    return held


def taken(part: LayerPart, points: NDArray[np.float64], labels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which of a placed scan's points belong to a part.

    Parameters
    ----------
    part : LayerPart
        What a layer takes.
    points : ndarray of shape (N, 3), float64
        In frame `map` [m].
    labels : ndarray of shape (N,), uint8
        `TARGET`, `REFERENCE` or `OUTLIER`; an outlier is in no part.
    """
    held = labels == TARGET if part.points == "target" else np.ones(len(points), dtype=np.bool_)
    for region in part.include:
        held = held | within(region, points)
    for region in part.exclude:
        held = held & ~within(region, points)
    return np.asarray(held & (labels != OUTLIER), dtype=np.bool_)


def _inside(xy: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points an upward or downward edge passes on the right an odd number of times."""
    inside = np.zeros(len(xy), dtype=np.bool_)
    x, y = xy[:, 0], xy[:, 1]
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if ay != by:
            crossed = (ay > y) != (by > y)
            inside ^= crossed & (x < (bx - ax) * (y - ay) / (by - ay) + ax)
    return inside
