"""Strokes to walls: filled bars, outlined pairs, and single lines."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.raster.ink import Ink
from worker.geometry.drawing.raster.opening import opened
from worker.geometry.drawing.raster.pairs import Pairs
from worker.geometry.drawing.raster.squeeze import Squeezed
from worker.geometry.drawing.raster.strokes import Strokes, find_strokes
from worker.geometry.drawing.reading.reading import Column, Wall

_THICK, _THICK_LINES, _THICK_PX, _THINNEST_LINE = 0.07, 2.5, 2.6, 0.08
_WALL_BAR = 0.4
_PIER_SURE = 0.3
_PIER_LEAST, _PIER_LEAST_PX, _PIER_FILL, _PIER_ASPECT = 0.15, 5.0, 0.6, 1.8
_MIN_OVERLAP = 0.3
_MIN_SINGLE = 0.7
_TOUCH = 0.15
_STEP = 0.05


def thick_mask(ink: Ink, mask: NDArray[np.bool_], line_width: float) -> NDArray[np.bool_]:
    """Return the part of the `mask` that is much thicker than the drawing's lines: filled walls and piers.

    `line_width` is that of the thin lines [m], of which 8 cm count at most; thick is 2.5 times as
    much, and at least 7 cm.
    """
    least = max(
        _THICK,
        _THICK_LINES * min(line_width, _THINNEST_LINE),
        _THICK_PX * ink.metres_per_px,
    )
    diameter = max(3, int(np.ceil(least / ink.metres_per_px)))
    return opened(mask, diameter)


def filled_walls(
    ink: Ink, thick: NDArray[np.bool_], *, least_pier: float
) -> tuple[list[Wall], list[Column], list[NDArray[np.float64]]]:
    """Return walls drawn as bars, with the drawn width as thickness, piers as columns, and what is neither.

    The third is the middle lines of thick parts that are too short for a wall and no pier: arrow heads,
    blots.
    """
    m = ink.metres_per_px
    squeezed = Squeezed.of(thick)
    columns, piers = _piers(ink, squeezed, min(least_pier, _PIER_SURE))
    strokes = find_strokes(replace(ink, contrast=squeezed.taken(ink.contrast)), squeezed.mask)
    strokes = replace(strokes, ends=squeezed.in_whole(strokes.ends))
    width, length = strokes.width * m, strokes.length * m
    keep = (length >= np.maximum(1.0 * width, 0.1)) & ~np.isin(strokes.part, piers)
    reach = np.zeros(int(strokes.part.max(initial=0)) + 1)
    np.maximum.at(reach, strokes.part, np.where(keep, length + width, 0.0))
    keep &= (reach[strokes.part] >= _WALL_BAR) & (length + width >= 1.6 * width)
    walls = []
    for i in np.flatnonzero(keep):
        more = strokes.direction[i] * strokes.width[i] / 2
        ends = np.vstack([strokes.ends[i, 0] - more, strokes.ends[i, 1] + more])
        walls.append(Wall.of(ink.to_drawing(ends), thickness=float(width[i])))
    known = np.isin(strokes.part, [*piers, *np.unique(strokes.part[keep])])
    return walls, columns, [ink.to_drawing(strokes.ends[i]) for i in np.flatnonzero(~known)]


def _piers(ink: Ink, thick: Squeezed, least: float) -> tuple[list[Column], list[int]]:
    """Return the solid parts about as long as wide as columns, and their numbers."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(thick.mask.astype(np.uint8), connectivity=8)
    m = ink.metres_per_px
    out: list[Column] = []
    piers: list[int] = []
    for part in range(1, count):
        x, y, w, h, area = stats[part]
        small = min(w, h) < max(_PIER_LEAST / m, _PIER_LEAST_PX, least / m)
        if small or area < _PIER_FILL * w * h or max(w, h) > _PIER_ASPECT * min(w, h):
            continue
        one = (labels[y : y + h, x : x + w] == part).astype(np.uint8)
        contours, _ = cv2.findContours(
            one, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE, offset=(int(x), int(y))
        )
        outline = cv2.approxPolyDP(contours[0], 1.5, closed=True).reshape(-1, 2)
        if len(outline) >= 3:
            out.append(Column(ink.to_drawing(thick.in_whole(outline.astype(np.float64)))))
            piers.append(part)
    return out, piers


def outlined_walls(
    ink: Ink, strokes: Strokes, pairs: Pairs, candidates: NDArray[np.bool_]
) -> tuple[list[Wall], list[NDArray[np.bool_]]]:
    """Return walls drawn as two parallel lines, and which 5 cm cells of each stroke they account for.

    The two lines are the faces, as far as they run side by side.
    """
    length = strokes.length * ink.metres_per_px
    used = [np.zeros(max(1, int(np.ceil(v / _STEP))), dtype=bool) for v in length]
    walls = []
    fair = (
        candidates[pairs.first]
        & candidates[pairs.second]
        & (pairs.overlap >= np.maximum(_MIN_OVERLAP, 1.2 * pairs.spacing))
    )
    for k in np.flatnonzero(fair):
        i, j = int(pairs.first[k]), int(pairs.second[k])
        along = strokes.direction[i if length[i] >= length[j] else j]
        low, high = np.sort(strokes.ends[[i, j]] @ along, axis=1).T
        shared = np.array([low.max(), high.min()])
        if shared[1] <= shared[0]:
            continue
        one, two = (ink.to_drawing(_mark(strokes.ends[n], along, shared, used[n])) for n in (i, j))
        thickness = float(np.hypot(*(one - two).mean(axis=0)))
        walls.append(Wall((one + two) / 2, thickness, _left_right(one, two)))
    return walls, used


def _mark(
    ends: NDArray[np.float64],
    along: NDArray[np.float64],
    shared: NDArray[np.float64],
    used: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the piece of a stroke in the `shared` stretch along a direction; mark its cells as used."""
    t = ends @ along
    share = (shared - t[0]) / (t[1] - t[0])
    first, last = np.sort(share) * len(used)
    used[max(0, int(np.floor(first))) : int(np.ceil(last))] = True
    return np.asarray(ends[0] + (ends[1] - ends[0]) * share[:, None], dtype=np.float64)


def rest(ends: NDArray[np.float64], used: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Return the pieces (2, 2) of a stroke whose cells are not used."""
    edge = np.diff(np.concatenate([[0], (~used).astype(np.int8), [0]]))
    runs = zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True)
    step = (ends[1] - ends[0]) / len(used)
    return [np.stack([ends[0] + step * a, ends[0] + step * b]) for a, b in runs]


def _left_right(
    one: NDArray[np.float64], two: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    step, across = one[1] - one[0], two[0] - one[0]
    return (two, one) if step[0] * across[1] - step[1] * across[0] > 0 else (one, two)


def single_walls(
    ink: Ink, strokes: Strokes, candidates: NDArray[np.bool_], anchored: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which candidate strokes are walls drawn as one line: long ones that lead from wall to wall.

    `anchored` strokes are walls already; a candidate of at least 70 cm with an end on a wall joins them,
    and then carries others. Where the drawing has no pair at all, every long candidate counts.
    """
    m = ink.metres_per_px
    long = candidates & (strokes.length * m >= _MIN_SINGLE)
    kept = anchored & candidates
    if not kept.any():
        return long
    waiting = np.flatnonzero(long & ~kept)
    body = np.flatnonzero(kept)
    while len(body) and len(waiting):
        joins = np.array([_touches(strokes, int(i), body, max(_TOUCH / m, 3.0)) for i in waiting], dtype=bool)
        body, waiting = waiting[joins], waiting[~joins]
        kept[body] = True
    return kept & long


def _touches(strokes: Strokes, i: int, body: NDArray[np.intp], reach: float) -> bool:
    """Return whether an end of stroke `i` lies on one of the strokes in `body`, or an end of theirs on it."""
    a, b = strokes.ends[body, 0], strokes.ends[body, 1]
    own = strokes.ends[i]
    for tip in own:
        if _distance(np.broadcast_to(tip, a.shape), a, b).min() <= reach:
            return True
    start, end = np.broadcast_to(own[0], a.shape), np.broadcast_to(own[1], a.shape)
    return bool(min(_distance(a, start, end).min(), _distance(b, start, end).min()) <= reach)


def _distance(p: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    d = b - a
    t = np.clip(((p - a) * d).sum(axis=1) / np.maximum((d**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.hypot(*(a + d * t[:, None] - p).T), dtype=np.float64)
