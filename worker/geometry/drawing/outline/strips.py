"""Strips of a solid outline: where two of its edges run opposite to each other with material between."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.errors import DrawingTooComplex

_OPPOSITE = -np.cos(np.deg2rad(20.0))
_BEND = np.cos(np.deg2rad(30.0))
_LEAST_PIECE = 0.005
_LEAST_RATIO = 1.0
_LEAST_THICKNESS = 0.004
_SAME_THICKNESS = 0.02
_TOUCH = 0.05
_SMOOTH = 0.002
_AT_ONCE = 500
_MOST_PAIRS = 10_000_000


@dataclass
class End:
    """Hold how far the two faces run on beyond a strip's end [m].

    Parameters
    ----------
    right, left : float
        Of the face to the right and to the left.
    centre_share : float
        Which share of that the centre line runs on: a half at a corner, all of it at a junction.
    """

    right: float = 0.0
    left: float = 0.0
    centre_share: float = 0.5


@dataclass(eq=False)
class Strip:
    """Hold a strip with material between its faces.

    Parameters
    ----------
    right, left : ndarray of shape (K, 2), float64
        The opposite points on the faces, in the direction in which `right` has the material on its left [m].
    start, end : End
        How the faces run on.
    """

    right: NDArray[np.float64]
    left: NDArray[np.float64]
    start: End = field(default_factory=End)
    end: End = field(default_factory=End)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Return the centre line [m]."""
        return np.asarray((self.right + self.left) / 2.0, dtype=np.float64)

    @property
    def length(self) -> float:
        """Return the length of the centre line [m]."""
        return float(np.hypot(*np.diff(self.centre, axis=0).T).sum())

    @property
    def thickness(self) -> float:
        """Return the mean distance between the faces, by length [m]."""
        gap = np.hypot(*(self.left - self.right).T)
        step = np.hypot(*np.diff(self.centre, axis=0).T)
        return float(np.average((gap[1:] + gap[:-1]) / 2.0, weights=np.maximum(step, 1e-9)))

    @property
    def cap_start(self) -> NDArray[np.float64]:
        """Return the line between the faces at the start, (2, 2) [m]."""
        return np.stack([self.right[0], self.left[0]])

    @property
    def cap_end(self) -> NDArray[np.float64]:
        """Return the line between the faces at the end, (2, 2) [m]."""
        return np.stack([self.right[-1], self.left[-1]])


@dataclass(frozen=True, eq=False)
class _Edges:
    """Hold the n directed edges of a body, material to their left."""

    a: NDArray[np.float64]
    b: NDArray[np.float64]
    after: NDArray[np.int64]
    along: NDArray[np.float64]
    length: NDArray[np.float64]

    @property
    def inward(self) -> NDArray[np.float64]:
        return np.column_stack([-self.along[:, 1], self.along[:, 0]])


@dataclass(frozen=True)
class _Piece:
    """Hold where edge `i` from `t0` to `t1` [m along it] faces edge `j` from `s0` down to `s1`."""

    i: int
    j: int
    t0: float
    t1: float
    s0: float
    s1: float


def find_strips(
    rings: list[NDArray[np.float64]], body: Any, *, max_thickness: float
) -> tuple[list[Strip], list[NDArray[np.float64]]]:
    """Return the strips of a body, and what is left of its outline as polylines.

    Parameters
    ----------
    rings : list of ndarrays of shape (K, 2), float64
        The body's rings, not closed, material to the left [m].
    body : shapely Polygon
        The same as a polygon.
    max_thickness : float
        The widest strip [m].

    Raises
    ------
    DrawingTooComplex
        If the edges lie so densely that too many pairs would have to be compared.

    Notes
    -----
    Each edge is cut where an opposite edge begins or ends, and each piece faces the nearest of them that it
    sees through the material; pieces that follow each other at one thickness are one strip, so that a curved
    wall of many chords is one wall. What is shorter than it is thick is no strip: two jambs face each other
    across a pier, too.
    """
    edges = _edges(rings)
    pieces = _visible(_pieces(edges, max_thickness), edges, body)
    strips: list[Strip] = []
    used: list[list[tuple[float, float, int, str]]] = [[] for _ in edges.length]
    for chain in _chains(pieces, edges):
        number, strip = len(strips), _strip(chain, edges)
        if strip.length < _LEAST_RATIO * strip.thickness:
            continue
        strips.append(strip)
        for piece in chain:
            used[piece.i].append((piece.t0, piece.t1, number, "right"))
            used[piece.j].append((piece.s1, piece.s0, number, "left"))
    rest = _rest(edges, used, strips, max_thickness)
    return strips, rest


def _edges(rings: list[NDArray[np.float64]]) -> _Edges:
    starts, ends, after = [], [], []
    base = 0
    for ring in rings:
        turned = np.roll(ring, -_sharpest(ring), axis=0)
        starts.append(turned)
        ends.append(np.roll(turned, -1, axis=0))
        after.append(base + (np.arange(len(ring)) + 1) % len(ring))
        base += len(ring)
    a, b = np.vstack(starts), np.vstack(ends)
    length = np.hypot(*(b - a).T)
    return _Edges(a, b, np.concatenate(after), (b - a) / np.maximum(length, 1e-12)[:, None], length)


def _sharpest(ring: NDArray[np.float64]) -> int:
    """Return the corner at which a ring turns the most: a curve is not cut there."""
    before, here = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    size = np.hypot(*before.T) * np.hypot(*here.T)
    return int(np.argmin((before * here).sum(axis=1) / np.maximum(size, 1e-12)))


def _pieces(edges: _Edges, max_thickness: float) -> list[_Piece]:
    """Return for each edge the opposite edges that come first, as pieces of it."""
    lines = shapely.linestrings(np.stack([edges.a, edges.b], axis=1))
    tree = shapely.STRtree(lines)
    out: list[_Piece] = []
    pairs = 0
    for first in range(0, len(lines), _AT_ONCE):
        some = lines[first : first + _AT_ONCE]
        one, other = tree.query(some, predicate="dwithin", distance=max_thickness)
        pairs += len(one)
        if pairs > _MOST_PAIRS:
            raise DrawingTooComplex(
                f"The outlines have {len(lines)} edges so close to each other that over {_MOST_PAIRS} pairs "
                "would be compared. Export a simpler model, or print the floor as an image."
            )
        facing = (edges.along[first + one] * edges.along[other]).sum(axis=1) <= _OPPOSITE
        order = np.argsort(one[facing], kind="stable")
        one, other = one[facing][order], other[facing][order]
        starts = np.searchsorted(one, np.arange(len(some) + 1))
        for i in range(len(some)):
            out += _pieces_of(first + i, other[starts[i] : starts[i + 1]], edges, max_thickness)
    return out


def _pieces_of(i: int, others: NDArray[np.int64], edges: _Edges, max_thickness: float) -> list[_Piece]:
    if not len(others):
        return []
    u, n, origin = edges.along[i], edges.inward[i], edges.a[i]
    ta, tb = (edges.b[others] - origin) @ u, (edges.a[others] - origin) @ u
    da, db = (edges.b[others] - origin) @ n, (edges.a[others] - origin) @ n
    low, high = np.clip(ta, 0.0, edges.length[i]), np.clip(tb, 0.0, edges.length[i])
    slope = (db - da) / np.where(np.abs(tb - ta) < 1e-9, 1e-9, tb - ta)
    cuts = np.unique(np.concatenate([low, high]).round(6))
    out = []
    for t0, t1 in pairwise(cuts):
        if t1 - t0 < _LEAST_PIECE:
            continue
        middle = (t0 + t1) / 2.0
        gap = da + slope * (middle - ta)
        seen = (low <= middle) & (high >= middle) & (gap > _LEAST_THICKNESS) & (gap <= max_thickness)
        if not seen.any():
            continue
        k = int(np.flatnonzero(seen)[np.argmin(gap[seen])])
        j = int(others[k])
        share = edges.length[j] / max(float(tb[k] - ta[k]), 1e-9)
        s0, s1 = ((tb[k] - t) * share for t in (t0, t1))
        out.append(_Piece(i, j, float(t0), float(t1), float(s0), float(s1)))
    return out


def _visible(pieces: list[_Piece], edges: _Edges, body: Any) -> list[_Piece]:
    """Return the pieces between whose middles there is nothing but material, each pair of edges once."""
    once = [p for p in pieces if p.i < p.j]
    if not once:
        return []
    ends = np.array([[_at(edges, p.i, (p.t0 + p.t1) / 2), _at(edges, p.j, (p.s0 + p.s1) / 2)] for p in once])
    grown = shapely.buffer(body, 0.001)
    shapely.prepare(grown)
    clear = shapely.covers(grown, shapely.linestrings(ends))
    return [p for p, sees in zip(once, clear, strict=True) if sees]


def _at(edges: _Edges, i: int, t: float) -> NDArray[np.float64]:
    return np.asarray(edges.a[i] + edges.along[i] * t, dtype=np.float64)


def _chains(pieces: list[_Piece], edges: _Edges) -> list[list[_Piece]]:
    """Return runs of pieces that go on into each other: one direction, one thickness, no gap."""
    chains: list[list[_Piece]] = []
    for piece in sorted(pieces, key=lambda p: (p.i, p.t0)):
        if chains and _goes_on(chains[-1][-1], piece, edges):
            chains[-1].append(piece)
        else:
            chains.append([piece])
    return chains


def _goes_on(one: _Piece, two: _Piece, edges: _Edges) -> bool:
    if two.i not in (one.i, edges.after[one.i]):
        return False
    if float(edges.along[one.i] @ edges.along[two.i]) < _BEND:
        return False
    ends = _at(edges, one.i, one.t1), _at(edges, one.j, one.s1)
    starts = _at(edges, two.i, two.t0), _at(edges, two.j, two.s0)
    gap_one, gap_two = (float(np.hypot(*(x - y))) for x, y in (ends, starts))
    reach = max(_TOUCH, 0.6 * gap_one) if two.i != one.i else _TOUCH
    near = all(float(np.hypot(*(x - y))) <= reach for x, y in zip(ends, starts, strict=True))
    return near and abs(gap_one - gap_two) <= max(_SAME_THICKNESS, 0.1 * gap_one)


def _strip(chain: list[_Piece], edges: _Edges) -> Strip:
    """Return a chain as a strip; where two chords meet, their ends are averaged."""
    right = np.array([[_at(edges, p.i, t) for t in (p.t0, p.t1)] for p in chain])
    left = np.array([[_at(edges, p.j, s) for s in (p.s0, p.s1)] for p in chain])
    faces = []
    for side in (right, left):
        joints = (side[:-1, 1] + side[1:, 0]) / 2.0
        faces.append(np.vstack([side[:1, 0], joints, side[-1:, 1]]))
    keep = _corners((faces[0] + faces[1]) / 2.0)
    return Strip(faces[0][keep], faces[1][keep])


def _corners(line: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return which points of a line a simpler one keeps (Douglas-Peucker, 2 mm)."""
    kept = shapely.get_coordinates(shapely.simplify(shapely.LineString(line), _SMOOTH))
    at, out = 0, []
    for point in kept:
        while at < len(line) - 1 and not np.array_equal(line[at], point):
            at += 1
        out.append(at)
    out[-1] = len(line) - 1
    return np.array(out, dtype=np.int64)


def _rest(
    edges: _Edges,
    used: list[list[tuple[float, float, int, str]]],
    strips: list[Strip],
    max_thickness: float,
) -> list[NDArray[np.float64]]:
    """Give the rests beside strips to these, and return the other rests of the outline as polylines."""
    rests: list[tuple[int, float, float]] = []
    for i, spans in enumerate(used):
        at, before = 0.0, None
        for t0, t1, number, side in sorted(spans):
            if t0 - at > _LEAST_PIECE and not _shared(
                t0 - at, before, (number, side), strips, most=max_thickness
            ):
                rests.append((i, at, t0))
            if t1 >= at:
                at, before = t1, (number, side)
        length = float(edges.length[i])
        if length - at > _LEAST_PIECE and not _shared(length - at, before, None, strips, most=max_thickness):
            rests.append((i, at, length))
    return _joined(rests, edges)


def _shared(
    gap: float,
    before: tuple[int, str] | None,
    after: tuple[int, str] | None,
    strips: list[Strip],
    *,
    most: float,
) -> bool:
    """Let the strips before and after a gap of one edge run on into it; return whether any did."""
    if gap > most or (before is None and after is None):
        return False
    both = before is not None and after is not None
    by = gap / 2.0 if both else gap
    for neighbour, ahead in ((before, True), (after, False)):
        if neighbour is None:
            continue
        number, side = neighbour
        strip = strips[number]
        end = strip.end if ahead == (side == "right") else strip.start
        setattr(end, side, by)
        end.centre_share = 1.0 if both else 0.5
    return True


def _joined(rests: list[tuple[int, float, float]], edges: _Edges) -> list[NDArray[np.float64]]:
    """Return the rests as polylines, joined where one goes on into the next over a corner of the outline."""
    lines: list[list[NDArray[np.float64]]] = []
    last: tuple[int, float] | None = None
    for i, t0, t1 in rests:
        goes_on = last is not None and edges.after[last[0]] == i and t0 == 0.0
        if goes_on and last is not None and last[1] >= float(edges.length[last[0]]) - _LEAST_PIECE:
            lines[-1].append(_at(edges, i, t1))
        else:
            lines.append([_at(edges, i, t0), _at(edges, i, t1)])
        last = (i, t1)
    return [np.array(line) for line in lines]
