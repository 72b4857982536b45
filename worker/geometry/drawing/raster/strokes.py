"""Ink to strokes: skeleton, branches, straight pieces, and pieces joined across crossings."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.raster.ink import Ink
from worker.geometry.drawing.raster.thinning import branches, thin

_STRAIGHT_PX = 1.3
_STRAIGHT = 0.012
_JOIN_PX = 5.0
_JOIN_COSINE = np.cos(np.radians(5.0))


@dataclass(frozen=True, eq=False)
class Strokes:
    """Hold N straight strokes, in working pixels (x right, y down).

    Parameters
    ----------
    ends : ndarray of shape (N, 2, 2), float64
        Start and end.
    width : ndarray of shape (N,)
        Width of the ink across the stroke.
    weight : ndarray of shape (N,)
        Darkness summed across the stroke: how heavy the pen was, finer than the width tells.
    part : ndarray of shape (N,), int
        Connected part of the ink that the stroke belongs to.
    """

    ends: NDArray[np.float64]
    width: NDArray[np.float64]
    weight: NDArray[np.float64]
    part: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ends)

    @cached_property
    def length(self) -> NDArray[np.float64]:
        """Return the (N,) lengths."""
        return np.asarray(np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T), dtype=np.float64)

    @cached_property
    def direction(self) -> NDArray[np.float64]:
        """Return the (N, 2) unit directions."""
        return np.asarray(
            (self.ends[:, 1] - self.ends[:, 0]) / np.maximum(self.length, 1e-9)[:, None], dtype=np.float64
        )

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Strokes:
        """Return the strokes at `index`."""
        return Strokes(self.ends[index], self.width[index], self.weight[index], self.part[index])


def find_strokes(ink: Ink, mask: NDArray[np.bool_]) -> Strokes:
    """Return the straight strokes of the `mask`, joined where they run on across a crossing.

    Notes
    -----
    Skeleton of Zhang and Suen; branches between junctions; Douglas-Peucker within 1.2 cm (at least 1.3 px);
    pieces whose ends meet within 5 px and that turn by less than 5 degrees become one stroke. One whole
    array of four bytes a working pixel at a time.
    """
    path, starts = branches(*thin(mask))
    if not len(path):
        return Strokes(np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))
    first, last = _pieces(path, starts, max(_STRAIGHT_PX, _STRAIGHT / ink.metres_per_px))
    padded = np.pad(mask, 1).view(np.uint8)
    half = np.asarray(cv2.distanceTransform(padded, cv2.DIST_L2, 5), dtype=np.float32)
    width = _medians(half[path[:, 0] + 1, path[:, 1] + 1], first, last)
    del half, padded
    _, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=8)
    part = labels[path[first, 0], path[first, 1]].astype(np.int64)
    del labels
    weight = _medians(_darkness(ink.contrast, path), first, last)
    ends = np.stack([path[first, ::-1], path[last, ::-1]], axis=1).astype(np.float64)
    pieces = Strokes(ends, np.maximum(2.0 * width - 1.0, 1.0), weight, part)
    return join_collinear(pieces, reach=_JOIN_PX)


@numba.njit(cache=True)
def _pieces(  # pragma: no cover - compiled
    path: NDArray[np.int64], starts: NDArray[np.int64], tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and last index into the (M, 2) path of each piece that Douglas and Peucker keep."""
    is_corner = np.zeros(len(path), dtype=np.bool_)
    stack = np.zeros((len(path) + 1, 2), dtype=np.int64)
    count = 0
    for walk in range(len(starts) - 1):
        stack[0] = starts[walk], starts[walk + 1] - 1
        is_corner[stack[0, 0]] = is_corner[stack[0, 1]] = True
        count += 1
        waiting = 1
        while waiting:
            waiting -= 1
            a, b = stack[waiting]
            farthest, worst = _farthest(path, a, b)
            if worst > tolerance * tolerance:
                is_corner[farthest] = True
                count += 1
                stack[waiting] = a, farthest
                stack[waiting + 1] = farthest, b
                waiting += 2
    ends = np.zeros((count, 2), dtype=np.int64)
    n = 0
    for walk in range(len(starts) - 1):
        begun = starts[walk]
        for k in range(starts[walk], starts[walk + 1]):
            if is_corner[k] and (k > begun or starts[walk + 1] - begun == 1):
                ends[n] = begun, k
                begun = k
                n += 1
    return ends[:n, 0].copy(), ends[:n, 1].copy()


@numba.njit(cache=True)
def _farthest(  # pragma: no cover - compiled
    path: NDArray[np.int64], a: int, b: int
) -> tuple[int, float]:
    """Return the point between two of the path that is farthest from their chord, and how far, squared."""
    dy, dx = path[b, 0] - path[a, 0], path[b, 1] - path[a, 1]
    squared = float(dx * dx + dy * dy)
    at, worst = a, 0.0
    for k in range(a + 1, b):
        y, x = float(path[k, 0] - path[a, 0]), float(path[k, 1] - path[a, 1])
        along = 0.0
        if squared > 0.0:
            along = min(max((x * dx + y * dy) / squared, 0.0), 1.0)
        off = (x - along * dx) ** 2 + (y - along * dy) ** 2
        if off > worst:
            at, worst = k, off
    return at, worst


@numba.njit(cache=True)
def _medians(  # pragma: no cover - compiled
    value: NDArray[np.float32], first: NDArray[np.int64], last: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the median of each piece's values, both ends included."""
    out = np.zeros(len(first))
    for i in range(len(first)):
        out[i] = np.median(value[first[i] : last[i] + 1])
    return out


@numba.njit(cache=True)
def _darkness(  # pragma: no cover - compiled
    contrast: NDArray[np.uint8], path: NDArray[np.int64]
) -> NDArray[np.float32]:
    """Return the contrast in a window of 7 x 7 around each point, summed across it."""
    out = np.zeros(len(path), dtype=np.float32)
    height, width = contrast.shape
    for k in range(len(path)):
        row, column = path[k]
        total = 0
        for y in range(max(0, row - 3), min(height, row + 4)):
            for x in range(max(0, column - 3), min(width, column + 4)):
                total += contrast[y, x]
        out[k] = total / 7.0
    return out


def join_collinear(pieces: Strokes, *, reach: float) -> Strokes:
    """Return strokes made of pieces whose ends meet within `reach` [px] and run on in the same direction."""
    n = len(pieces)
    tips = pieces.ends.reshape(-1, 2)
    outward = np.stack([-pieces.direction, pieces.direction], axis=1).reshape(-1, 2)
    long = np.maximum(pieces.length, 1e-9)
    pairs = cKDTree(tips).query_pairs(reach, output_type="ndarray")
    pairs = pairs[pairs[:, 0] // 2 != pairs[:, 1] // 2]
    a, b = pairs.T
    gap = tips[b] - tips[a]
    turn = -(outward[a] * outward[b]).sum(axis=1)
    longer = np.where((long[a // 2] >= long[b // 2])[:, None], outward[a], outward[b])
    aside = np.abs(gap[:, 0] * longer[:, 1] - gap[:, 1] * longer[:, 0])
    shorter = np.minimum(long[a // 2], long[b // 2])
    allowed = np.where(shorter > 12, _JOIN_COSINE, np.cos(np.radians(20.0)))
    good = (turn > allowed) & (aside <= 2.0) & (long[a // 2] > 2) & (long[b // 2] > 2)
    a, b = a[good], b[good]
    best = np.argsort(aside[good] + 20 * (1 - turn[good]), kind="stable")
    return _chain(pieces, n, a[best], b[best])


def _chain(pieces: Strokes, n: int, a: NDArray[np.intp], b: NDArray[np.intp]) -> Strokes:
    parent = np.arange(n)

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = int(parent[i])
        return i

    used = np.zeros(2 * n, dtype=bool)
    for i, j in zip(a.tolist(), b.tolist(), strict=True):
        if not used[i] and not used[j]:
            used[i] = used[j] = True
            parent[root(i // 2)] = root(j // 2)
    group = np.array([root(i) for i in range(n)])
    _, group = np.unique(group, return_inverse=True)
    return _fit(pieces, group)


def _fit(pieces: Strokes, group: NDArray[np.intp]) -> Strokes:
    """Return one straight stroke a group: the least-squares line through its pieces, weighted by length."""
    count = int(group.max()) + 1
    length = np.maximum(pieces.length, 1e-3)

    def total(value: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.bincount(group, weights=value, minlength=count), dtype=np.float64)

    whole = total(length)
    middle = pieces.ends.mean(axis=1)
    centre = np.column_stack([total(length * middle[:, k]) / whole for k in (0, 1)])
    off = pieces.ends - centre[group][:, None]
    xx, yy, xy = (
        total(length * (off[..., i] * off[..., j]).sum(axis=1)) for i, j in ((0, 0), (1, 1), (0, 1))
    )
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    along = (off * direction[group][:, None]).sum(axis=2)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, group, along.min(axis=1))
    np.maximum.at(high, group, along.max(axis=1))
    ends = np.stack([centre + direction * low[:, None], centre + direction * high[:, None]], axis=1)
    longest = np.lexsort((length, group))
    last = longest[np.append(np.flatnonzero(np.diff(group[longest])), len(group) - 1)]
    return Strokes(
        ends, total(length * pieces.width) / whole, total(length * pieces.weight) / whole, pieces.part[last]
    )
