"""Walls from straight lines that are known to be walls: exact faces, thickness and centre lines."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.errors import DrawingTooComplex
from worker.geometry.drawing.reading.reading import Wall

THINNEST, THICKEST = 0.03, 0.65
"""Between these distances two parallel lines [m] may be the faces of one wall."""

_PARALLEL = np.sin(np.radians(1.5))
_LEAST_OVERLAP = 0.02
_LEAST_PIECE = 0.005
_LEAST_RATIO = 1.0
_SAME_SPACING = 0.012
_CAP_REACH = 0.02
_AT_ONCE = 100
_BIN = np.pi / 60
_MOST_PAIRS = 20_000_000

Spans = list[tuple[float, float]]
Tell = Callable[[float], None]


@dataclass(frozen=True)
class Stretch:
    """Hold where line `i` from `t0` to `t1` [m along it] and line `j` run side by side, `spacing` [m] apart.

    `s0` and `s1` are the places on line `j` opposite `t0` and `t1`.
    """

    i: int
    j: int
    t0: float
    t1: float
    s0: float
    s1: float
    spacing: float

    @property
    def length(self) -> float:
        """Return how long the two run side by side [m]."""
        return self.t1 - self.t0


@dataclass(frozen=True, eq=False)
class Lines:
    """Hold N lines by a point, a direction and a length [m]."""

    start: NDArray[np.float64]
    along: NDArray[np.float64]
    length: NDArray[np.float64]

    @classmethod
    def of(cls, ends: NDArray[np.float64]) -> Lines:
        """Return the lines of (N, 2, 2) ends."""
        step = ends[:, 1] - ends[:, 0]
        length = np.hypot(step[:, 0], step[:, 1])
        return cls(ends[:, 0].copy(), step / np.maximum(length, 1e-12)[:, None], length)

    def at(self, i: int, t: float) -> NDArray[np.float64]:
        """Return the point of line `i` at `t` [m along it]."""
        return np.asarray(self.start[i] + self.along[i] * t, dtype=np.float64)

    def piece(self, i: int, t0: float, t1: float) -> NDArray[np.float64]:
        """Return a piece of a line as (2, 2) points."""
        return np.stack([self.at(i, t0), self.at(i, t1)])


def distinct(ends: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which of (N, 2, 2) lines are left when repeated ones (to 1 mm) and points are taken out."""
    if not len(ends):
        return np.zeros(0, dtype=np.int64)
    key = np.round(ends * 1000.0).astype(np.int64)
    swap = (key[:, 0, 0] > key[:, 1, 0]) | ((key[:, 0, 0] == key[:, 1, 0]) & (key[:, 0, 1] > key[:, 1, 1]))
    key[swap] = key[swap][:, ::-1]
    _, first = np.unique(key.reshape(len(ends), 4), axis=0, return_index=True)
    first = np.sort(first)
    length = np.hypot(*(ends[first, 1] - ends[first, 0]).T)
    return np.asarray(first[length > _LEAST_PIECE], dtype=np.int64)


def stretches(
    lines: Lines,
    *,
    thickest: float = THICKEST,
    thinnest: float = THINNEST,
    least: float = _LEAST_OVERLAP,
    tell: Tell | None = None,
) -> list[Stretch]:
    """Return where two of the lines face each other, nothing parallel between them.

    Parameters
    ----------
    lines : Lines
        Without repeated ones.
    thickest, thinnest : float
        Largest and smallest distance [m].
    least : float
        How long two lines run side by side at least [m].
    tell : callable, optional
        Told the share done.

    Raises
    ------
    DrawingTooComplex
        If the lines lie so densely that too many pairs would have to be compared.

    Notes
    -----
    Each line is cut where a parallel one begins or ends, on either side, and each piece faces the nearest; a
    stretch is where two lines face each other mutually. Parallel is within 1.5 degrees.
    """
    if crowded(lines, reach=thickest):
        raise _too_dense(len(lines.length))
    seen: dict[tuple[int, int], Spans] = defaultdict(list)
    compared, count = 0, len(lines.length)
    for done, one, other in _side_by_side(lines, reach=thickest):
        if tell is not None:
            tell(done)
        compared += len(one)
        if compared > _MOST_PAIRS:
            raise _too_dense(count)
        _see(lines, one, other, between=(thinnest, thickest), least=least, seen=seen)
    return _mutual(lines, seen, least)


def _side_by_side(
    lines: Lines, *, reach: float
) -> Iterator[tuple[float, NDArray[np.int64], NDArray[np.int64]]]:
    """Return the share done, and pairs of about one direction whose boxes along it lie within `reach`.

    The lines are sorted into bins of direction; each bin is turned level, where a line's box is as slim as
    the line, and compared with itself and its two neighbours.
    """
    count = round(np.pi / _BIN)
    angle = np.arctan2(lines.along[:, 1], lines.along[:, 0]) % np.pi
    own = np.floor(angle / _BIN).astype(np.int64) % count
    done = 0
    for n in np.unique(own).tolist():
        near = np.flatnonzero(np.isin(own, [(n - 1) % count, n, (n + 1) % count]))
        mine = np.flatnonzero(own[near] == n)
        box = _level_boxes(lines, near, (n + 0.5) * _BIN)
        tree = shapely.STRtree(shapely.box(*box.T))
        wide = shapely.box(*(box[mine] + np.array([0.0, -reach, 0.0, reach])).T)
        for first in range(0, len(mine), _AT_ONCE):
            one, other = tree.query(wide[first : first + _AT_ONCE])
            yield (done + first) / len(own), near[mine[one + first]], near[other]
        done += len(mine)


def _level_boxes(lines: Lines, which: NDArray[np.int64], angle: float) -> NDArray[np.float64]:
    """Return (M, 4) left, bottom, right, top of some lines, turned back by an angle [rad]."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    start = lines.start[which] @ turn
    end = start + (lines.along[which] * lines.length[which][:, None]) @ turn
    return np.hstack([np.minimum(start, end), np.maximum(start, end)])


def crowded(lines: Lines, *, reach: float) -> bool:
    """Return whether so many lines lie within `reach` [m] of each other that comparing them is hopeless."""
    middle = lines.start + lines.along * (lines.length / 2.0)[:, None]
    low = middle.min(axis=0)
    cell = np.minimum(np.floor((middle - low) / max(reach, 1e-9)), 2.0**31).astype(np.int64)
    _, count = np.unique(cell[:, 0] << 32 | cell[:, 1], return_counts=True)
    return float((count.astype(np.float64) ** 2).sum()) > _MOST_PAIRS / 2


def _too_dense(count: int) -> DrawingTooComplex:
    return DrawingTooComplex(
        f"{count} lines lie so close to each other that over {_MOST_PAIRS} pairs would be compared. Export "
        "the one floor that is needed, or print the sheet as an image."
    )


def _see(
    lines: Lines,
    one: NDArray[np.int64],
    other: NDArray[np.int64],
    *,
    between: tuple[float, float],
    least: float,
    seen: dict[tuple[int, int], Spans],
) -> None:
    """Note for each line on which pieces which parallel line is the nearest on either side."""
    u = lines.along[one]
    sine = np.abs(u[:, 0] * lines.along[other, 1] - u[:, 1] * lines.along[other, 0])
    keep = (one != other) & (sine < _PARALLEL)
    one, other, u = one[keep], other[keep], u[keep]
    a = lines.start[other] - lines.start[one]
    b = a + lines.along[other] * lines.length[other][:, None]
    ta, tb = (a * u).sum(axis=1), (b * u).sum(axis=1)
    low = np.maximum(np.minimum(ta, tb), 0.0)
    high = np.minimum(np.maximum(ta, tb), lines.length[one])
    middle = (a + b) / 2.0
    gap = u[:, 0] * middle[:, 1] - u[:, 1] * middle[:, 0]
    keep = (high - low > least) & (np.abs(gap) >= between[0]) & (np.abs(gap) <= between[1])
    one, other, low, high, gap = one[keep], other[keep], low[keep], high[keep], gap[keep]
    side = 2 * one + (gap > 0)
    order = np.argsort(side, kind="stable")
    bounds = np.flatnonzero(np.diff(side[order], prepend=-1, append=-1))
    for lo, hi in pairwise(bounds):
        some = order[lo:hi]
        i = int(one[some[0]])
        for t0, t1, k in _nearest(low[some], high[some], np.abs(gap[some])):
            seen[i, int(other[some[k]])].append((t0, t1))


def _nearest(
    low: NDArray[np.float64], high: NDArray[np.float64], gap: NDArray[np.float64]
) -> list[tuple[float, float, int]]:
    """Return which of several spans is the nearest from where to where."""
    if len(low) == 1:
        return [(float(low[0]), float(high[0]), 0)]
    cuts = np.unique(np.concatenate([low, high]))
    middle = (cuts[1:] + cuts[:-1]) / 2.0
    here = (low[:, None] <= middle) & (high[:, None] >= middle)
    cost = np.where(here, gap[:, None], np.inf)
    best = cost.argmin(axis=0)
    out: list[tuple[float, float, int]] = []
    for n, k in enumerate(best.tolist()):
        if not np.isfinite(cost[k, n]):
            continue
        if out and out[-1][2] == k and out[-1][1] == cuts[n]:
            out[-1] = (out[-1][0], float(cuts[n + 1]), k)
        else:
            out.append((float(cuts[n]), float(cuts[n + 1]), k))
    return out


def _mutual(lines: Lines, seen: dict[tuple[int, int], Spans], least: float) -> list[Stretch]:
    out: list[Stretch] = []
    for (i, j), spans in seen.items():
        back = seen.get((j, i))
        if i > j or back is None:
            continue
        offset = lines.start[j] - lines.start[i]
        base, slope = float(offset @ lines.along[i]), float(lines.along[j] @ lines.along[i])
        sign = 1.0 if slope > 0 else -1.0
        theirs = [tuple(sorted((base + sign * s0, base + sign * s1))) for s0, s1 in back]
        for t0, t1 in spans:
            for b0, b1 in theirs:
                lo, hi = max(t0, b0), min(t1, b1)
                if hi - lo < least:
                    continue
                middle = lines.at(i, (lo + hi) / 2.0) - lines.start[j]
                gap = abs(float(lines.along[j, 0] * middle[1] - lines.along[j, 1] * middle[0]))
                out.append(Stretch(i, j, lo, hi, sign * (lo - base), sign * (hi - base), gap))
    return out


def pair_lines(
    ends: NDArray[np.float64], *, thickest: float = THICKEST, tell: Tell | None = None
) -> list[Wall]:
    """Return the walls that (N, 2, 2) lines [m] make, so that every line is a face of a wall.

    Two lines that face each other are the two faces of a wall; of several that could, the nearest. What has
    no counterpart stays a wall of thickness 0 whose two faces are the line itself (``partition``), but for
    the short ends between two faces, which close these.

    Raises
    ------
    DrawingTooComplex
        If the lines lie so densely that too many pairs would have to be compared.
    """
    ends = ends[distinct(ends)]
    if not len(ends):
        return []
    lines = Lines.of(ends)
    used: list[Spans] = [[] for _ in lines.length]
    walls: list[_Draft] = []
    for stretch in sorted(stretches(lines, thickest=thickest, tell=tell), key=lambda s: s.spacing):
        if stretch.length < _LEAST_RATIO * stretch.spacing:
            continue
        if _covered(used[stretch.i], stretch.t0, stretch.t1) and _covered(
            used[stretch.j], *sorted((stretch.s0, stretch.s1))
        ):
            continue
        walls.append(_Draft(stretch))
        used[stretch.i].append((stretch.t0, stretch.t1))
        used[stretch.j].append((min(stretch.s0, stretch.s1), max(stretch.s0, stretch.s1)))
    rest = _rest(lines, used)
    return _closed([d.wall(lines) for d in walls], [lines.piece(*r) for r in rest])


@dataclass(frozen=True)
class _Draft:
    """Hold a wall before its faces are laid."""

    stretch: Stretch

    def wall(self, lines: Lines) -> Wall:
        s = self.stretch
        one, two = lines.piece(s.i, s.t0, s.t1), lines.piece(s.j, s.s0, s.s1)
        step, across = one[1] - one[0], two[0] - one[0]
        faces = (two, one) if step[0] * across[1] - step[1] * across[0] > 0 else (one, two)
        return Wall((one + two) / 2.0, s.spacing, faces)


def _covered(spans: Spans, low: float, high: float) -> bool:
    """Return whether more than half of a span is covered by others."""
    return sum(max(0.0, min(high, b) - max(low, a)) for a, b in spans) > 0.5 * (high - low)


def _rest(lines: Lines, used: list[Spans]) -> list[tuple[int, float, float]]:
    """Return the pieces of lines that no wall uses."""
    out = []
    for i, spans in enumerate(used):
        at, length = 0.0, float(lines.length[i])
        for low, high in sorted(spans):
            if low - at > _LEAST_PIECE:
                out.append((i, at, low))
            at = max(at, high)
        if length - at > _LEAST_PIECE:
            out.append((i, at, length))
    return out


def _closed(walls: list[Wall], rest: list[NDArray[np.float64]]) -> list[Wall]:
    """Return the walls, with the pieces that run on from their faces or close their ends, and the others.

    A piece that goes straight on from a face (behind it another wall begins) lengthens the face; one between
    the two faces closes the wall.
    """
    tips: dict[tuple[int, int], list[tuple[int, int, int]]] = defaultdict(list)
    faces = [[list(f) for f in wall.faces] for wall in walls]
    for n, wall in enumerate(walls):
        for side in (0, 1):
            for end in (0, -1):
                tips[_cell(wall.faces[side][end])].append((n, side, end))
    single = [piece for piece in rest if not _attached(piece, walls, faces, tips)]
    out = []
    for wall, (left, right) in zip(walls, faces, strict=True):
        out.append(Wall(wall.centre, wall.thickness, (np.array(left), np.array(right)), wall.kind))
    return out + [Wall(piece, 0.0, (piece, piece), "partition") for piece in single]


def _cell(point: NDArray[np.float64]) -> tuple[int, int]:
    return int(np.floor(point[0] / _CAP_REACH)), int(np.floor(point[1] / _CAP_REACH))


def _attached(
    piece: NDArray[np.float64],
    walls: list[Wall],
    faces: list[list[list[NDArray[np.float64]]]],
    tips: dict[tuple[int, int], list[tuple[int, int, int]]],
) -> bool:
    """Give a short piece to the wall at whose end it lies; return whether there is one."""
    length = float(np.hypot(*(piece[1] - piece[0])))
    if length > THICKEST + _CAP_REACH:
        return False
    for own in (0, 1):
        for n, side, end in _near_tips(piece[own], tips):
            tip = faces[n][side][end]
            if float(np.hypot(*(tip - piece[own]))) > _CAP_REACH:
                continue
            if length > 1.5 * walls[n].thickness + _CAP_REACH:
                continue
            face = faces[n][side]
            face.insert(0 if end == 0 else len(face), piece[1 - own])
            return True
    return False


def _near_tips(
    point: NDArray[np.float64], tips: dict[tuple[int, int], list[tuple[int, int, int]]]
) -> list[tuple[int, int, int]]:
    x, y = _cell(point)
    return [tip for dx in (-1, 0, 1) for dy in (-1, 0, 1) for tip in tips.get((x + dx, y + dy), ())]
