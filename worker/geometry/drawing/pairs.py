"""Parallel strokes at a wall's thickness, and regular rows of parallels (stairs, planks, tiles)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.strokes import Strokes

THINNEST, THICKEST = 0.05, 0.5
_STEP = 0.05
_PARALLEL_SINE = np.sin(np.radians(4.0))
_SAME_PLACE = 0.04


@dataclass(frozen=True, eq=False)
class Pairs:
    """Hold P pairs of neighbouring parallel strokes.

    Parameters
    ----------
    first, second : ndarray of shape (P,), int
        Indices of strokes; first < second.
    spacing : ndarray of shape (P,)
        Median distance between the two [m].
    overlap : ndarray of shape (P,)
        Length along which they run side by side, nothing parallel between them [m].
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    spacing: NDArray[np.float64]
    overlap: NDArray[np.float64]


def find_pairs(strokes: Strokes, metres_per_px: float, *, among: NDArray[np.bool_] | None = None) -> Pairs:
    """Return which strokes of those `among` which to look run parallel, 5 to 50 cm apart, side by side.

    Notes
    -----
    Parallel is within 4 degrees. Each stroke is sampled every 5 cm; a sample looks for the nearest sample
    of a parallel stroke on each of its sides.
    """
    wanted = np.arange(len(strokes)) if among is None else np.flatnonzero(among)
    xy, owner, direction = _samples(strokes.take(wanted), metres_per_px)
    owner = wanted[owner]
    if not len(xy):
        none = np.zeros(0, dtype=np.int64)
        return Pairs(none, none, np.zeros(0), np.zeros(0))
    near = cKDTree(xy).query_pairs(THICKEST + _STEP, output_type="ndarray")
    a, b = near.T
    a, b = np.concatenate([a, b]), np.concatenate([b, a])
    keep = owner[a] != owner[b]
    a, b = a[keep], b[keep]
    gap = xy[b] - xy[a]
    along = np.abs((gap * direction[a]).sum(axis=1))
    across = direction[a, 0] * gap[:, 1] - direction[a, 1] * gap[:, 0]
    sine = np.abs(direction[a, 0] * direction[b, 1] - direction[a, 1] * direction[b, 0])
    keep = (sine < _PARALLEL_SINE) & (along <= _STEP * 0.75) & (np.abs(across) >= THINNEST * 0.8)
    a, b, across = a[keep], b[keep], across[keep]
    side = 2 * a + (across > 0)
    order = np.lexsort((np.abs(across), side))
    nearest = order[np.append(True, np.diff(side[order]) != 0)] if len(order) else order
    return _counted(owner[a[nearest]], owner[b[nearest]], np.abs(across[nearest]), len(strokes))


def _samples(
    strokes: Strokes, metres_per_px: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    length = strokes.length * metres_per_px
    count = np.maximum(1, np.ceil(length / _STEP)).astype(np.int64)
    owner = np.repeat(np.arange(len(strokes)), count)
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(len(owner)) - first + 0.5) / count[owner]
    start, end = strokes.ends[owner, 0], strokes.ends[owner, 1]
    return (start + (end - start) * share[:, None]) * metres_per_px, owner, strokes.direction[owner]


def _counted(a: NDArray[np.int64], b: NDArray[np.int64], distance: NDArray[np.float64], count: int) -> Pairs:
    low, high = np.minimum(a, b), np.maximum(a, b)
    key = low * count + high
    order = np.lexsort((distance, key))
    unique, start, n = np.unique(key[order], return_index=True, return_counts=True)
    spacing = distance[order][start + n // 2]
    wanted = (spacing >= THINNEST) & (spacing <= THICKEST)
    return Pairs(
        (unique // count)[wanted], (unique % count)[wanted], spacing[wanted], (n * _STEP / 2)[wanted]
    )


def regular_patterns(strokes: Strokes, pairs: Pairs, *, least_members: int = 5) -> NDArray[np.bool_]:
    """Return which strokes belong to a row of `least_members` or more alike parallels at one spacing.

    Stair treads, planks and tiles lie at wall spacing, but walls do not come in rows.
    """
    length = strokes.length
    alike = np.minimum(length[pairs.first], length[pairs.second]) >= 0.6 * np.maximum(
        length[pairs.first], length[pairs.second]
    )
    first, second, spacing = pairs.first[alike], pairs.second[alike], pairs.spacing[alike]
    links = list(zip(first.tolist(), second.tolist(), spacing.tolist(), strict=True))
    out = np.zeros(len(strokes), dtype=bool)
    for members in _rows(strokes, links):
        if len(members) >= least_members:
            out[list(members)] = True
    return out


def _rows(strokes: Strokes, links: list[tuple[int, int, float]]) -> list[set[int]]:
    """Return sets of strokes: two links of one stroke, to either side and of one spacing, continue a row."""
    at: dict[int, list[int]] = {}
    for k, (i, j, _) in enumerate(links):
        at.setdefault(i, []).append(k)
        at.setdefault(j, []).append(k)
    parent = list(range(len(links)))

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for i, own in at.items():
        for k, n in combinations(own, 2):
            d, e = links[k][2], links[n][2]
            others = [links[q][0] + links[q][1] - i for q in (k, n)]
            if abs(d - e) <= max(0.02, 0.12 * d) and not _same_side(strokes, i, *others):
                parent[root(k)] = root(n)
    rows: dict[int, set[int]] = {}
    for k, (i, j, _) in enumerate(links):
        rows.setdefault(root(k), set()).update((i, j))
    return list(rows.values())


def _same_side(strokes: Strokes, i: int, j: int, m: int) -> bool:
    middle = strokes.ends[[i, j, m]].mean(axis=1)
    along = strokes.ends[i, 1] - strokes.ends[i, 0]
    off = middle[1:] - middle[0]
    across = along[0] * off[:, 1] - along[1] * off[:, 0]
    return bool(across[0] * across[1] > 0)
