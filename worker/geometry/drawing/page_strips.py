"""Walls that a vector page draws as two lines: the material between parallel strokes of one pen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

LEAST_GAP, LARGEST_GAP = 0.055, 0.62
"""Faces nearer or farther than this [m] are not those of one wall."""

_ANGLE_STEP = np.radians(0.5)
_OFFSET_STEP, _JOIN = 0.008, 0.02
_LEAST_FACE, _LEAST_OVERLAP = 0.12, 0.1
_PARALLEL = np.sin(np.radians(1.0))
_MOST_NEIGHBOURS = 4
_AT_ONCE, _MOST_PAIRS = 2_000, 3_000_000


@dataclass(frozen=True, eq=False)
class Strips:
    """Hold the strips between faces of one pen.

    Parameters
    ----------
    areas : ndarray of shape (N,), object
        Rectangles of material [m].
    length : ndarray of shape (N,), float64
        How far the two faces overlap [m].
    drawn : float
        Length of all strokes of the pen that are long enough for a face [m].
    faces : ndarray of shape (F, 2, 2), float64
        Those strokes, joined where they go on.
    """

    areas: NDArray[np.object_]
    length: NDArray[np.float64]
    drawn: float
    faces: NDArray[np.float64]

    @property
    def paired(self) -> float:
        """Return how much of the strokes belongs to a pair [m]."""
        return 2.0 * float(self.length.sum())


def joined(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (S, 2, 2) segments [m] with those on one line that touch or overlap made one.

    Lines within half a degree and 8 mm are one line; gaps of up to 2 cm are closed.
    """
    step = ends[:, 1] - ends[:, 0]
    length = np.hypot(step[:, 0], step[:, 1])
    ends, step, length = ends[length > 1e-6], step[length > 1e-6], length[length > 1e-6]
    if not len(ends):
        return np.zeros((0, 2, 2))
    turn = np.rint(np.mod(np.arctan2(step[:, 1], step[:, 0]), np.pi) / _ANGLE_STEP).astype(np.int64)
    turn %= round(np.pi / _ANGLE_STEP)
    along = np.column_stack([np.cos(turn * _ANGLE_STEP), np.sin(turn * _ANGLE_STEP)])
    across = np.column_stack([-along[:, 1], along[:, 0]])
    offset = (ends.mean(axis=1) * across).sum(axis=1)
    row = np.rint(offset / _OFFSET_STEP).astype(np.int64)
    t = np.sort((ends * along[:, None]).sum(axis=2), axis=1)
    order = np.lexsort((t[:, 0], row, turn))
    t, turn, row, offset, length = t[order], turn[order], row[order], offset[order], length[order]
    along, across = along[order], across[order]
    new_line = np.concatenate([[True], (np.diff(turn) != 0) | (np.diff(row) != 0)])
    line = np.cumsum(new_line) - 1
    reach = np.maximum.accumulate(t[:, 1] + line * _FAR) - line * _FAR  # running end within each line
    apart = np.concatenate([[True], t[1:, 0] > reach[:-1] + _JOIN]) | new_line
    group = np.cumsum(apart) - 1
    first = np.flatnonzero(apart)
    low, high = t[first, 0], np.maximum.reduceat(t[:, 1], first)
    middle = np.bincount(group, weights=offset * length) / np.bincount(group, weights=length)
    base = across[first] * middle[:, None]
    return np.stack([base + along[first] * low[:, None], base + along[first] * high[:, None]], axis=1)


_FAR = 1e7


def find_pen_strips(ends: NDArray[np.float64]) -> Strips:
    """Return the strips of material between the strokes of one pen, each stretch of a stroke used once.

    Parameters
    ----------
    ends : ndarray of shape (S, 2, 2), float64
        Segments of one pen [m].

    Returns
    -------
    Strips
        The nearest pairs come first, so that the space between two walls is not taken for a third. Strokes
        with more than four parallels within 0.6 m are a pattern (tiles, treads, planks) and pair with none.
        At a corner a strip runs on as far as the longer face does.
    """
    faces = joined(ends)
    length = np.hypot(*(faces[:, 1] - faces[:, 0]).T)
    faces, length = faces[length >= _LEAST_FACE], length[length >= _LEAST_FACE]
    none = np.zeros(0, dtype=np.object_)
    if len(faces) < 2:
        return Strips(none, np.zeros(0), float(length.sum()), faces)
    along = (faces[:, 1] - faces[:, 0]) / length[:, None]
    i, j = _parallels(faces, along)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    t = np.sort(((faces[j] - faces[i][:, :1]) * along[i][:, None]).sum(axis=2), axis=1)
    gap = ((faces[j].mean(axis=1) - faces[i][:, 0]) * across[i]).sum(axis=1)
    low, high = np.maximum(t[:, 0], 0.0), np.minimum(t[:, 1], length[i])
    overlap = high - low
    near = (np.abs(gap) >= 0.02) & (np.abs(gap) <= LARGEST_GAP) & (overlap >= _LEAST_OVERLAP)
    crowd = np.bincount(np.concatenate([i[near], j[near]]), minlength=len(faces))
    fits = near & (np.abs(gap) >= LEAST_GAP) & (overlap >= 0.7 * np.abs(gap))
    fits &= (crowd[i] <= _MOST_NEIGHBOURS) & (crowd[j] <= _MOST_NEIGHBOURS)
    order = np.flatnonzero(fits)
    order = order[np.lexsort((-overlap[order], np.round(np.abs(gap[order]), 2)))]
    used: dict[int, list[tuple[float, float]]] = {}
    areas, lengths = [], []
    for k in order:
        a, b = int(i[k]), int(j[k])
        shift = float(((faces[a][0] - faces[b][0]) * along[b]).sum())
        same_way = float(along[a] @ along[b]) > 0
        for lo, hi in _free(used, a, (low[k], high[k])):
            span_b = (shift + lo, shift + hi) if same_way else (shift - hi, shift - lo)
            for lo_b, hi_b in _free(used, b, span_b):
                piece = (lo_b - shift, hi_b - shift) if same_way else (shift - hi_b, shift - lo_b)
                if piece[1] - piece[0] < max(_LEAST_OVERLAP, 0.7 * abs(gap[k])):
                    continue
                used.setdefault(a, []).append(piece)
                used.setdefault(b, []).append((lo_b, hi_b))
                at = _to_corners(piece, (low[k], high[k]), t[k], float(length[a]))
                areas.append(_rectangle(faces[a][0], along[a], across[a], at, float(gap[k])))
                lengths.append(piece[1] - piece[0])
    found = np.array(areas, dtype=np.object_) if areas else none
    return Strips(found, np.array(lengths), float(length.sum()), faces)


def _parallels(
    faces: NDArray[np.float64], along: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of nearly parallel strokes within reach of each other."""
    lines = shapely.linestrings(faces)
    tree = shapely.STRtree(lines)
    out = []
    total = 0
    for first in range(0, len(lines), _AT_ONCE):
        one, other = tree.query(lines[first : first + _AT_ONCE], predicate="dwithin", distance=LARGEST_GAP)
        one = one + first
        total += len(one)
        turn = along[one, 0] * along[other, 1] - along[one, 1] * along[other, 0]
        kept = (one < other) & (np.abs(turn) <= _PARALLEL)
        out.append(np.stack([one[kept], other[kept]]))
        if total > _MOST_PAIRS:
            break
    pairs = np.concatenate(out, axis=1).astype(np.int64)
    return pairs[0], pairs[1]


def _free(
    used: dict[int, list[tuple[float, float]]], face: int, span: tuple[float, float]
) -> list[tuple[float, float]]:
    """Return what of a stretch of a face belongs to no strip yet."""
    parts = [span]
    for lo, hi in used.get(face, ()):
        left = [(a, min(b, lo)) for a, b in parts if a < lo]
        parts = left + [(max(a, hi), b) for a, b in parts if b > hi]
    return [(a, b) for a, b in parts if b - a > 1e-3]


def _to_corners(
    piece: tuple[float, float], overlap: tuple[float, float], other: NDArray[np.float64], length: float
) -> tuple[float, float]:
    """Return a stretch that runs on at a corner, where one of its faces is longer by at most a wall."""
    low, high = piece
    outer_low, outer_high = min(0.0, float(other[0])), max(length, float(other[1]))
    if low == overlap[0] and low - outer_low <= LARGEST_GAP:
        low = outer_low
    if high == overlap[1] and outer_high - high <= LARGEST_GAP:
        high = outer_high
    return low, high


def _rectangle(
    origin: NDArray[np.float64],
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    at: tuple[float, float],
    gap: float,
) -> shapely.Polygon:
    near = [origin + along * at[0], origin + along * at[1]]
    return shapely.Polygon([*near, near[1] + across * gap, near[0] + across * gap])
