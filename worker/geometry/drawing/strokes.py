"""Ink to strokes: skeleton, branches, straight pieces, and pieces joined across crossings."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree
from skimage.morphology import skeletonize

from worker.geometry.drawing.ink import Ink

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

    @property
    def length(self) -> NDArray[np.float64]:
        """Return the (N,) lengths."""
        return np.asarray(np.hypot(*(self.ends[:, 1] - self.ends[:, 0]).T), dtype=np.float64)

    @property
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
    Skeleton by `skimage.morphology.skeletonize`; branches between junctions; Douglas-Peucker within 1.2 cm
    (at least
    1.3 px); pieces whose ends meet within 5 px and that turn by less than 5 degrees become one stroke.
    """
    skeleton = np.asarray(skeletonize(mask), dtype=np.bool_)  # type: ignore[no-untyped-call]
    half = cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    _, parts = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    summed = cv2.boxFilter(ink.contrast, cv2.CV_32F, (7, 7), normalize=False) / 7.0
    order, starts = branches(skeleton)
    tolerance = max(_STRAIGHT_PX, _STRAIGHT / ink.metres_per_px)
    ends, width, weight, part = [], [], [], []
    for a, b in pairwise(starts.tolist()):
        path = order[a:b]
        corner = _corners(path, tolerance)
        for i, j in pairwise(corner.tolist()):
            middle = path[i : j + 1]
            rows, columns = middle[:, 0], middle[:, 1]
            ends.append((path[i, ::-1], path[j, ::-1]))
            width.append(2.0 * float(np.median(half[rows, columns])) - 1.0)
            weight.append(float(np.median(summed[rows, columns])))
            part.append(int(parts[rows[0], columns[0]]))
    if not ends:
        return Strokes(np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64))
    pieces = Strokes(
        np.array(ends, dtype=np.float64),
        np.maximum(np.array(width), 1.0),
        np.array(weight),
        np.array(part, dtype=np.int64),
    )
    return join_collinear(pieces, reach=_JOIN_PX)


def branches(skeleton: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the skeleton's pixels as (M, 2) rows and columns in walking order, and where branches start.

    Junction pixels (three neighbours or more) belong to no branch. A closed loop is cut at its first pixel.
    """
    padded = np.pad(skeleton, 1).astype(np.uint8)
    kernel = np.ones((3, 3), dtype=np.uint8)
    kernel[1, 1] = 0
    neighbours = ndimage.convolve(padded, kernel, mode="constant") * padded
    paths = ((padded > 0) & (neighbours <= 2)).astype(np.uint8)
    degree = ndimage.convolve(paths, kernel, mode="constant") * paths
    tips = np.flatnonzero((paths > 0) & (degree <= 1))
    others = np.flatnonzero((paths > 0) & (degree > 1))
    order, starts = _walk(paths.ravel(), np.concatenate([tips, others]), padded.shape[1])
    rows, columns = np.divmod(order, padded.shape[1])
    return np.column_stack([rows - 1, columns - 1]), starts


@numba.njit(cache=True)
def _walk(  # pragma: no cover - compiled
    paths: NDArray[np.uint8], seeds: NDArray[np.int64], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return flat pixel indices in walking order from each unvisited seed, and where walks start."""
    left = paths.copy()
    order = np.zeros(len(seeds), dtype=np.int64)
    starts = np.zeros(len(seeds) + 1, dtype=np.int64)
    steps = np.array([-1, 1, -width, width, -width - 1, -width + 1, width - 1, width + 1])
    n = 0
    walks = 0
    for seed in seeds:
        if left[seed] == 0:
            continue
        starts[walks] = n
        walks += 1
        at = seed
        while True:
            left[at] = 0
            order[n] = at
            n += 1
            found = -1
            for step in steps:
                if left[at + step] != 0:
                    found = at + step
                    break
            if found < 0:
                break
            at = found
    starts[walks] = n
    return order[:n], starts[: walks + 1]


def _corners(path: NDArray[np.int64], tolerance: float) -> NDArray[np.intp]:
    """Return the indices into the path that Douglas-Peucker keeps."""
    if len(path) <= 2:
        return np.array([0, len(path) - 1], dtype=np.intp)
    points = path.astype(np.int32).reshape(-1, 1, 2)
    kept = cv2.approxPolyDP(points, tolerance, closed=False).reshape(-1, 2)
    key = path[:, 0] * (path.max() + 2) + path[:, 1]
    wanted = kept[:, 0].astype(np.int64) * (path.max() + 2) + kept[:, 1]
    return np.unique(np.concatenate([[0, len(path) - 1], np.flatnonzero(np.isin(key, wanted))])).astype(
        np.intp
    )


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
