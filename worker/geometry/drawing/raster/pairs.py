"""Parallel strokes at a wall's thickness, and regular rows of parallels (stairs, planks, tiles)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.raster.strokes import Strokes

THINNEST, THICKEST = 0.05, 0.5
_STEP = 0.05
_PARALLEL_SINE = float(np.sin(np.radians(4.0)))


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
    Parallel is within 4 degrees. The strokes are drawn with their numbers; from each one, every 5 cm, a ray
    is sent to either side, and the first parallel stroke that it meets is the neighbour there.
    """
    wanted = np.arange(len(strokes)) if among is None else np.flatnonzero(among)
    if not len(wanted):
        none = np.zeros(0, dtype=np.int64)
        return Pairs(none, none, np.zeros(0), np.zeros(0))
    chosen = strokes.take(wanted)
    low = np.floor(chosen.ends.min(axis=(0, 1))) - 2.0
    ends = chosen.ends - low
    size = (np.ceil(ends.max(axis=(0, 1))) + 3.0).astype(int)
    numbers = np.zeros((int(size[1]), int(size[0])), dtype=np.int32)
    for k, (a, b) in enumerate(np.rint(ends).astype(int).tolist()):
        cv2.line(numbers, a, b, k + 1)
    xy, owner = _samples(ends, _STEP / metres_per_px)
    met, far = _first_parallel(numbers, xy, owner, chosen.direction, ends[:, 0], THICKEST / metres_per_px)
    source, side = np.nonzero(met >= 0)
    far_m = far[source, side] * metres_per_px
    return _counted(wanted[owner[source]], wanted[met[source, side]], far_m, len(strokes))


def _samples(ends: NDArray[np.float64], step: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return points every `step` along the strokes, and the number of the stroke of each."""
    along = ends[:, 1] - ends[:, 0]
    count = np.maximum(1, np.ceil(np.hypot(along[:, 0], along[:, 1]) / step)).astype(np.int64)
    owner = np.repeat(np.arange(len(ends), dtype=np.int64), count)
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(len(owner)) - first + 0.5) / count[owner]
    return np.asarray(ends[owner, 0] + along[owner] * share[:, None], dtype=np.float64), owner


@numba.njit(cache=True)
def _first_parallel(  # pragma: no cover - compiled
    numbers: NDArray[np.int32],
    xy: NDArray[np.float64],
    owner: NDArray[np.int64],
    direction: NDArray[np.float64],
    start: NDArray[np.float64],
    reach: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return, for each point and side, the first parallel stroke that a ray across meets, and how far."""
    height, width = numbers.shape
    met = np.full((len(xy), 2), -1, dtype=np.int64)
    far = np.zeros((len(xy), 2))
    for k in range(len(xy)):
        own = owner[k]
        dx, dy = direction[own, 0], direction[own, 1]
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            nx, ny = -dy * sign, dx * sign
            t = 1.0
            while t <= reach + 1.0:
                column, row = int(np.rint(xy[k, 0] + nx * t)), int(np.rint(xy[k, 1] + ny * t))
                if row < 0 or column < 0 or row >= height or column >= width:
                    break
                other = numbers[row, column] - 1
                if other >= 0 and other != own:
                    ex, ey = direction[other, 0], direction[other, 1]
                    if abs(dx * ey - dy * ex) < _PARALLEL_SINE:
                        across = (xy[k, 0] - start[other, 0]) * ey - (xy[k, 1] - start[other, 1]) * ex
                        if abs(abs(across) - t) <= 2.0:
                            met[k, side] = other
                            far[k, side] = abs(across)
                            break
                t += 0.5
    return met, far


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
