"""Walls that a vector page draws as two lines: the material between parallel strokes of one pen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from service.domain.errors import DrawingTooComplex

LEAST_GAP, LARGEST_GAP = 0.055, 0.62
"""Faces nearer or farther than this [m] are not those of one wall."""

_SAME_LINE = np.sin(np.radians(0.5))
_OFFSET, _JOIN = 0.008, 0.02
_LEAST_FACE, _LEAST_OVERLAP = 0.12, 0.1
_PARALLEL = np.sin(np.radians(1.0))
_MOST_NEIGHBOURS, _EVEN = 4, 0.04
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
    along = step / length[:, None]
    i, j = _near(ends, along, reach=_JOIN, parallel=_SAME_LINE)
    longer = length[i] >= length[j]
    i, j = np.where(longer, i, j), np.where(longer, j, i)
    away = ends[j] - ends[i][:, :1]
    off = np.abs(away[..., 0] * along[i][:, 1:] - away[..., 1] * along[i][:, :1]).max(axis=1)
    one = off <= _OFFSET
    links = coo_matrix((np.ones(int(one.sum())), (i[one], j[one])), shape=(len(ends), len(ends)))
    count, group = connected_components(links, directed=False)
    order = np.lexsort((-length, group))
    first = np.zeros(count, dtype=np.int64)
    first[group[order[::-1]]] = order[::-1]  # the longest of each group, which is written last
    base, way = ends[first, 0], along[first]
    t = ((ends - base[group][:, None]) * way[group][:, None]).sum(axis=2)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, group, t.min(axis=1))
    np.maximum.at(high, group, t.max(axis=1))
    return np.stack([base + way * low[:, None], base + way * high[:, None]], axis=1)


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
        with more than four parallels within 0.6 m, or in the middle between two, are a pattern (treads)
        and pair with none. At a corner a strip runs on as far as the longer face does.
    """
    faces = joined(ends)
    length = np.hypot(*(faces[:, 1] - faces[:, 0]).T)
    faces, length = faces[length >= _LEAST_FACE], length[length >= _LEAST_FACE]
    none = np.zeros(0, dtype=np.object_)
    if len(faces) < 2:
        return Strips(none, np.zeros(0), float(length.sum()), faces)
    along = (faces[:, 1] - faces[:, 0]) / length[:, None]
    i, j = _near(faces, along, reach=LARGEST_GAP, parallel=_PARALLEL)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    t = np.sort(((faces[j] - faces[i][:, :1]) * along[i][:, None]).sum(axis=2), axis=1)
    gap = ((faces[j].mean(axis=1) - faces[i][:, 0]) * across[i]).sum(axis=1)
    low, high = np.maximum(t[:, 0], 0.0), np.minimum(t[:, 1], length[i])
    overlap = high - low
    near = (np.abs(gap) >= 0.02) & (np.abs(gap) <= LARGEST_GAP) & (overlap >= _LEAST_OVERLAP)
    crowd = np.bincount(np.concatenate([i[near], j[near]]), minlength=len(faces))
    same = (along[i] * along[j]).sum(axis=1) > 0
    share = (overlap[near] / length[i[near]], overlap[near] / length[j[near]])
    odd = (crowd > _MOST_NEIGHBOURS) | _patterned(
        (i[near], j[near]), gap[near], share, same[near], len(faces)
    )
    fits = near & (np.abs(gap) >= LEAST_GAP) & (overlap >= 0.7 * np.abs(gap)) & ~odd[i] & ~odd[j]
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


def _near(
    segments: NDArray[np.float64], along: NDArray[np.float64], *, reach: float, parallel: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of segments within reach of each other whose turn has at most the sine `parallel`."""
    lines = shapely.linestrings(segments)
    tree = shapely.STRtree(lines)
    out = [np.zeros((2, 0), dtype=np.int64)]
    total = 0
    for first in range(0, len(lines), _AT_ONCE):
        one, other = tree.query(lines[first : first + _AT_ONCE], predicate="dwithin", distance=reach)
        one = one + first
        total += len(one)
        turn = along[one, 0] * along[other, 1] - along[one, 1] * along[other, 0]
        kept = (one < other) & (np.abs(turn) <= parallel)
        out.append(np.stack([one[kept], other[kept]]).astype(np.int64))
        if total > _MOST_PAIRS:
            raise DrawingTooComplex(
                "The strokes of the page lie so densely that they cannot be compared; export only the floor "
                "that is needed, or print the sheet as a PNG image."
            )
    pairs = np.concatenate(out, axis=1)
    return pairs[0], pairs[1]


def _patterned(
    pairs: tuple[NDArray[np.int64], NDArray[np.int64]],
    gap: NDArray[np.float64],
    share: tuple[NDArray[np.float64], NDArray[np.float64]],
    same_way: NDArray[np.bool_],
    count: int,
) -> NDArray[np.bool_]:
    """Return which strokes stand in the middle between two neighbours, as treads, tiles and axes do."""
    i, j = pairs
    owner = np.concatenate([i[share[0] >= 0.5], j[share[1] >= 0.5]])
    seen = np.concatenate([gap[share[0] >= 0.5], np.where(same_way, -gap, gap)[share[1] >= 0.5]])
    left, right = np.full(count, np.inf), np.full(count, np.inf)
    np.minimum.at(left, owner[seen > 0], seen[seen > 0])
    np.minimum.at(right, owner[seen < 0], -seen[seen < 0])
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(left - right) <= _EVEN * np.minimum(left, right), dtype=np.bool_)


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
