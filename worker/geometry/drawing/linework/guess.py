"""Walls of a vector drawing whose layers say nothing: by pen, by filled strips, by parallel pairs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.pairs import Lines, Stretch, stretches
from worker.geometry.drawing.linework.roles import UNTOLD, Roles, entity_lengths

_CURVES = ("arc", "circle", "ellipse", "spline", "dimension", "leader", "hatch")
_THIN, _THICK = 0.05, 0.5
_LEAST_RUN, _LEAST_RATIO = 0.3, 1.5
_SAME_SPACING = 0.08
_REACH = 0.03
_CAP, _LONG = 0.7, 0.7
_WHOLE_PEN = 0.6
_LEAST_LINES = 8
_SHARE_OF_BEST, _PAIRS_OF_BEST = 0.5, 0.15
_HEAVY = 0.8
_STRIP_RATIO = 2.0
_MOST_GROUPS = 200
_MOST_LINES = 200_000


@dataclass(frozen=True, eq=False)
class _Pen:
    """Hold what one pen drew: entities, lines, which of them are paired, and how much of its length."""

    segment: NDArray[np.int64]
    kept: NDArray[np.bool_]
    paired: float
    share: float
    width: float


def guess_walls(
    linework: Linework, roles: Roles, *, metres_per_unit: float, tell: Callable[[float], None]
) -> Roles:
    """Return the roles with walls found by geometry, where neither a person nor a name told them.

    Filled strips are the walls where there are enough of them. Else the lines of each pen (layer, colour and
    width) are paired at 5 to 50 cm; rows of alike parallels (stairs, planks, tiles) count for nothing; the
    walls are drawn by the pen with the longest and purest pairs, and by others that come near it. Of a pen
    that draws other things too, only the pairs are taken and what closes or joins them.
    """
    free = _eligible(linework, roles)
    strips = _strips(linework, roles, metres_per_unit)
    if strips.any():
        return roles.with_walls(strips, _reasons(linework, strips, "Its filled areas are shaped like walls."))
    pens = _pens(linework, free, metres_per_unit, tell)
    chosen = _chosen(pens)
    if not chosen:
        return roles.with_walls(np.zeros(len(linework.kind), dtype=np.bool_), {})
    length = np.hypot(*(linework.ends[:, 1] - linework.ends[:, 0]).T)
    own = np.zeros(len(linework.ends))
    for pen in chosen:
        own[pen.segment[pen.kept]] = length[pen.segment[pen.kept]]
    taken = np.bincount(linework.entity, weights=own, minlength=len(linework.kind))
    walls = taken > 0.5 * entity_lengths(linework)
    return roles.with_walls(walls, _reasons(linework, walls, "Its lines run in pairs at a wall's thickness."))


def _reasons(linework: Linework, walls: NDArray[np.bool_], reason: str) -> dict[int, str]:
    return {int(n): reason for n in np.unique(linework.layer[walls])}


def _eligible(linework: Linework, roles: Roles) -> NDArray[np.bool_]:
    """Return the entities that may be walls: straight, not dashed, on layers whose names say nothing else."""
    untold = np.array([r == UNTOLD for r in roles.layer_reason] or [True])[linework.layer]
    straight = ~np.isin(linework.kind, _CURVES) & ~linework.dashed & ~linework.filled
    named = roles.entity == "wall"
    free = straight & (untold | named)
    if free.sum() >= _LEAST_LINES:
        return np.asarray(free, dtype=np.bool_)
    return np.asarray(straight & np.isin(roles.entity, ["other", "wall", "column"]), dtype=np.bool_)


def _strips(linework: Linework, roles: Roles, metres: float) -> NDArray[np.bool_]:
    """Return the filled areas shaped like walls, if they are as long as the drawing; else none."""
    out = np.zeros(len(linework.kind), dtype=np.bool_)
    filled = linework.filled & np.isin(roles.entity, ["other", "wall", "hatch"])
    if not filled.any() or not len(linework.ends):
        return out
    step = linework.ends[:, 1] - linework.ends[:, 0]
    a, b = linework.ends[:, 0], linework.ends[:, 1]
    centre = linework.ends.reshape(-1, 2).mean(axis=0)
    cross = (a[:, 0] - centre[0]) * (b[:, 1] - centre[1]) - (b[:, 0] - centre[0]) * (a[:, 1] - centre[1])
    around = np.bincount(linework.entity, weights=np.hypot(*step.T), minlength=len(out)) * metres
    area = np.abs(np.bincount(linework.entity, weights=cross, minlength=len(out))) / 2 * metres**2
    thickness = 2 * area / np.maximum(around, 1e-9)
    strip = filled & (thickness >= _THIN) & (thickness <= _THICK) & (around >= 2 * _STRIP_RATIO * thickness)
    best = np.zeros_like(out)
    for colour in np.unique(linework.colour[strip]):
        same = strip & (linework.colour == colour)
        if around[same].sum() > around[best].sum():
            best = same
    extent = float(np.ptp(linework.ends.reshape(-1, 2), axis=0).max()) * metres
    return best if around[best].sum() / 2 >= extent else out


def _pens(
    linework: Linework, free: NDArray[np.bool_], metres: float, tell: Callable[[float], None]
) -> list[_Pen]:
    """Return what each pen drew, with its pairs."""
    width = np.where(np.isnan(linework.width), -1.0, linework.width)
    key = np.stack(
        [linework.layer, linework.colour.astype(np.int64), (width * 1000).astype(np.int64)], axis=1
    )
    _, pen = np.unique(key, axis=0, return_inverse=True)
    pen = pen.reshape(-1)[linework.entity]
    usable = np.flatnonzero(free[linework.entity])
    groups = [usable[pen[usable] == n] for n in np.unique(pen[usable])]
    groups = sorted((g for g in groups if len(g) >= _LEAST_LINES), key=len, reverse=True)[:_MOST_GROUPS]
    out = []
    for n, group in enumerate(groups):
        tell(n / len(groups))
        if len(group) <= _MOST_LINES:
            weight = float(linework.width[linework.entity[group[0]]])
            out.append(_pen(linework.ends[group] * metres, group, weight))
    return out


def _pen(ends: NDArray[np.float64], group: NDArray[np.int64], width: float) -> _Pen:
    lines = Lines.of(ends)
    found = [
        s
        for s in stretches(lines, thickest=_THICK)
        if s.spacing >= _THIN and s.length >= max(_LEAST_RUN, _LEAST_RATIO * s.spacing)
    ]
    rows = _rows(found)
    found = [s for s in found if s.i not in rows and s.j not in rows]
    paired = sum(s.length for s in found)
    total = max(float(lines.length.sum()), 1e-9)
    share = min(1.0, 2 * paired / total)
    kept = np.zeros(len(ends), dtype=np.bool_)
    kept[[s.i for s in found]] = True
    kept[[s.j for s in found]] = True
    if share >= _WHOLE_PEN:
        kept[[n for n in range(len(kept)) if n not in rows]] = True
    else:
        kept = _joined(ends, lines, kept, rows)
    return _Pen(group, kept, paired, share, width)


def _rows(found: list[Stretch]) -> set[int]:
    """Return the lines that have an alike neighbour at one spacing on both sides: stairs, planks, tiles."""
    beside: dict[int, list[tuple[float, float, float]]] = defaultdict(list)
    for s in found:
        beside[s.i].append((s.spacing, s.t0, s.t1))
        beside[s.j].append((s.spacing, min(s.s0, s.s1), max(s.s0, s.s1)))
    middle: set[int] = set()
    for line, spans in beside.items():
        for n, (gap, low, high) in enumerate(spans):
            for other, lo, hi in spans[n + 1 :]:
                shared = min(high, hi) - max(low, lo)
                if abs(gap - other) <= _SAME_SPACING * gap and shared >= 0.5 * min(high - low, hi - lo):
                    middle.add(line)
    out = set(middle)
    for s in found:
        if s.i in middle or s.j in middle:
            out |= {s.i, s.j}
    return out


def _joined(
    ends: NDArray[np.float64], lines: Lines, kept: NDArray[np.bool_], rows: set[int]
) -> NDArray[np.bool_]:
    """Return the kept lines with those that close or join them: short ones at one end, long ones at both."""
    out = kept.copy()
    barred = np.zeros(len(kept), dtype=np.bool_)
    barred[list(rows)] = True
    for _ in range(2):
        if not out.any():
            return out
        tree = cKDTree(ends[out].reshape(-1, 2))
        near = np.asarray(tree.query(ends.reshape(-1, 2))[0]).reshape(-1, 2) <= _REACH
        short = (lines.length <= _CAP) & near.any(axis=1)
        out |= ~barred & (short | ((lines.length >= _LONG) & near.all(axis=1)))
    return out


def _chosen(pens: list[_Pen]) -> list[_Pen]:
    """Return the pens that draw walls: those with the best pairs, and of these the heaviest."""
    fair = [p for p in pens if p.paired > 0]
    if not fair:
        return []
    best = max(fair, key=lambda p: p.paired * p.share)
    near = [
        p
        for p in fair
        if p is best or (p.share >= _SHARE_OF_BEST * best.share and p.paired >= _PAIRS_OF_BEST * best.paired)
    ]
    heaviest = max((p.width for p in near if not np.isnan(p.width)), default=0.0)
    return [p for p in near if not p.width < _HEAVY * heaviest]
