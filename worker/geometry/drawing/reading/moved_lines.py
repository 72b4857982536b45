"""Lines that a person calls walls, to walls: parallel ones to faces, single ones to partitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.reading.bodies import wall_body
from worker.geometry.drawing.reading.reading import Wall

THINNEST, THICKEST = 0.04, 0.6
_PARALLEL_SINE = float(np.sin(np.radians(4.0)))
_LEAST_OVERLAP = 0.25
_LEAST_REST = 0.1
_MOST_PAIRS = 200_000

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class _Pair:
    """Hold two parallel segments and the stretch, along the first, on which they run side by side."""

    first: int
    second: int
    spacing: float
    shared: Interval


def walls_of_lines(
    lines: Sequence[NDArray[np.float64]], *, metres_per_unit: float, reason: str
) -> list[Wall]:
    """Return the walls that lines show.

    Segments that run side by side 4 to 60 cm apart are the two faces of a wall, the nearest ones first; what
    is left is a partition of no thickness, unless it lies within a wall found here, as its end does.

    Parameters
    ----------
    lines : sequence of ndarrays of shape (K, 2)
        Polylines [units of the reading].
    metres_per_unit : float
        Metres in such a unit, or what is taken for it: sizes are judged by it.
    reason : str
        Why these are walls.

    Notes
    -----
    Parallel is within 4 degrees. Neighbours are looked up in a tree: O(n log n) for n segments.
    """
    segments = _segments(lines, least=1e-3 / metres_per_unit)
    used: list[list[Interval]] = [[] for _ in segments]
    walls = []
    for pair in _pairs(segments, metres_per_unit):
        for low, high in _free(pair, segments, used, least=_LEAST_OVERLAP / metres_per_unit):
            walls.append(_wall(segments[pair.first], segments[pair.second], (low, high), reason))
            used[pair.first].append((low, high))
            used[pair.second].append(_projected(segments[pair.first], segments[pair.second], (low, high)))
    bodies = shapely.union_all([wall_body(w) for w in walls]).buffer(0.02 / metres_per_unit)
    shapely.prepare(bodies)
    for segment, taken in zip(segments, used, strict=True):
        for low, high in _gaps(taken, float(np.hypot(*(segment[1] - segment[0])))):
            piece = _piece(segment, (low, high))
            if high - low >= _LEAST_REST / metres_per_unit and not bodies.covers(shapely.LineString(piece)):
                walls.append(Wall(piece, 0.0, (piece, piece), "partition", 1.0, reason))
    return walls


def _segments(lines: Sequence[NDArray[np.float64]], *, least: float) -> list[NDArray[np.float64]]:
    pairs = [np.stack([a, b]) for line in lines for a, b in pairwise(line)]
    return [pair for pair in pairs if float(np.hypot(*(pair[1] - pair[0]))) > least]


def _pairs(segments: list[NDArray[np.float64]], m: float) -> list[_Pair]:
    """Return pairs at a wall's spacing, the closest first; ties by the longer overlap."""
    if not segments:
        return []
    shapes = shapely.linestrings(np.array(segments))
    tree = shapely.STRtree(shapes)
    first, second = tree.query(shapes, predicate="dwithin", distance=THICKEST / m)
    keep = first < second
    pairs = [
        pair
        for i, j in zip(first[keep][:_MOST_PAIRS].tolist(), second[keep][:_MOST_PAIRS].tolist(), strict=True)
        if (pair := _pair(segments, i, j, m)) is not None
    ]
    return sorted(
        pairs, key=lambda p: (round(p.spacing * m, 3), p.shared[0] - p.shared[1], p.first, p.second)
    )


def _pair(segments: list[NDArray[np.float64]], i: int, j: int, m: float) -> _Pair | None:
    if np.hypot(*(segments[i][1] - segments[i][0])) < np.hypot(*(segments[j][1] - segments[j][0])):
        i, j = j, i
    a, b = segments[i], segments[j]
    along, length = _direction(a)
    other, _ = _direction(b)
    if abs(along[0] * other[1] - along[1] * other[0]) > _PARALLEL_SINE:
        return None
    across = (b - a[0]) @ np.array([-along[1], along[0]])
    spacing = float(abs(across.mean()))
    low, high = sorted(((b - a[0]) @ along).tolist())
    low, high = max(low, 0.0), min(high, length)
    fair = THINNEST <= spacing * m <= THICKEST and across[0] * across[1] > 0
    return _Pair(i, j, spacing, (low, high)) if fair and high - low > 1.2 * spacing else None


def _free(
    pair: _Pair, segments: list[NDArray[np.float64]], used: list[list[Interval]], *, least: float
) -> list[Interval]:
    """Return the stretches of a pair that neither of its segments has given to another."""
    taken = used[pair.first] + [
        _projected(segments[pair.second], segments[pair.first], one) for one in used[pair.second]
    ]
    low, high = pair.shared
    inside = [(max(a, low), min(b, high)) for a, b in taken if b > low and a < high]
    gaps = _gaps([(a - low, b - low) for a, b in inside], high - low)
    return [(a + low, b + low) for a, b in gaps if b - a >= least]


def _projected(source: NDArray[np.float64], target: NDArray[np.float64], stretch: Interval) -> Interval:
    """Return a stretch of one segment as a stretch of a parallel one."""
    along, length = _direction(target)
    ends = np.clip((_piece(source, stretch) - target[0]) @ along, 0.0, length)
    return float(ends.min()), float(ends.max())


def _gaps(taken: list[Interval], length: float) -> list[Interval]:
    """Return what of 0..length is not in the intervals."""
    gaps, at = [], 0.0
    for low, high in sorted(taken):
        if low > at:
            gaps.append((at, low))
        at = max(at, high)
    if at < length:
        gaps.append((at, length))
    return gaps


def _piece(segment: NDArray[np.float64], stretch: Interval) -> NDArray[np.float64]:
    along, _ = _direction(segment)
    return np.asarray(segment[0] + np.array(stretch)[:, None] * along, dtype=np.float64)


def _direction(segment: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    step = segment[1] - segment[0]
    length = float(np.hypot(*step))
    return step / length, length


def _wall(a: NDArray[np.float64], b: NDArray[np.float64], stretch: Interval, reason: str) -> Wall:
    one = _piece(a, stretch)
    low, high = _projected(a, b, stretch)
    two = _piece(b, (low, high))
    if ((two[1] - two[0]) * (one[1] - one[0])).sum() < 0:
        two = two[::-1]
    step, across = one[1] - one[0], two[0] - one[0]
    left, right = (two, one) if step[0] * across[1] - step[1] * across[0] > 0 else (one, two)
    thickness = float(np.hypot(*(one - two).mean(axis=0)))
    return Wall((one + two) / 2, thickness, (left, right), "wall", 1.0, reason)
