"""What is no wall is set aside (paper, section 2.2, step 2): specks, text, symbols, dashes, light lines."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.pairs import Pairs
from worker.geometry.drawing.strokes import Strokes

SPECK, TEXT, SYMBOL = 0.12, 0.7, 2.4
_BOX_ASPECT, _BOX_THICKEST, _BOX_SHORTEST = 2.2, 0.45, 0.5
_DASH_SHORTEST, _DASH_LONGEST, _DASH_GAP, _DASH_MEMBERS = 0.06, 2.0, 0.45, 4
_LIGHT_PEN = 0.6
_BAR_FILL = 0.55
_PIER_FILL, _PIER_LEAST = 0.8, 0.15


@dataclass(frozen=True, eq=False)
class Parts:
    """Hold the P connected parts of the ink, part 0 being the paper.

    Parameters
    ----------
    extent : ndarray of shape (P,)
        Longer side of the bounding box [m].
    long, short : ndarray of shape (P,)
        Sides of the smallest rectangle, turned as it fits, around the part [m].
    fill : ndarray of shape (P,)
        Share of that rectangle that is ink.
    """

    extent: NDArray[np.float64]
    long: NDArray[np.float64]
    short: NDArray[np.float64]
    fill: NDArray[np.float64]


def measure_parts(mask: NDArray[np.bool_], metres_per_px: float) -> Parts:
    """Return the sizes of the 8-connected parts, numbered as `find_strokes` numbers them."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    extent = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) * metres_per_px
    long, short = extent.copy(), extent.copy()
    for part in np.flatnonzero((extent > SPECK) & (extent < SYMBOL * 4)):
        x, y, w, h, _ = stats[part]
        points = cv2.findNonZero((labels[y : y + h, x : x + w] == part).astype(np.uint8))
        sides = cv2.minAreaRect(points)[1]
        long[part], short[part] = (np.array(sorted(sides, reverse=True)) + 1) * metres_per_px
    long[0] = short[0] = extent[0] = 0.0
    area = stats[:, cv2.CC_STAT_AREA] * metres_per_px**2
    return Parts(extent, long, short, area / np.maximum(long * short, 1e-12))


def small_parts(strokes: Strokes, parts: Parts, metres_per_px: float) -> dict[str, NDArray[np.bool_]]:
    """Return, by layer, which strokes belong to specks, text and symbols.

    A free-standing part is spared that is long and narrow as a wall drawn in outline, or solid as a pier.
    """
    extent = parts.long[strokes.part]
    box = (
        (parts.short[strokes.part] <= _BOX_THICKEST)
        & (parts.long[strokes.part] >= _BOX_SHORTEST)
        & (parts.long[strokes.part] >= _BOX_ASPECT * parts.short[strokes.part])
        & (parts.short[strokes.part] >= max(0.05, 4 * metres_per_px))
    )
    box |= (parts.fill[strokes.part] >= _PIER_FILL) & (parts.short[strokes.part] >= _PIER_LEAST)
    speck = extent < SPECK
    text = ~speck & (extent < TEXT) & ~box
    symbol = ~speck & ~text & (extent < SYMBOL) & ~box
    return {"speck": speck, "text": text, "symbol": symbol}


def dashed(strokes: Strokes, parts: Parts, metres_per_px: float) -> NDArray[np.bool_]:
    """Return which strokes are dashes: free bars in a row of at least four, with gaps of up to 45 cm.

    Dashed lines show what is not at walking height: roof edges, beams, site limits, doors in planning.
    """
    solid = (parts.fill >= _BAR_FILL) | (parts.short <= 4 * metres_per_px)
    bar = solid & (parts.short <= max(0.25, 3 * metres_per_px)) & (parts.long <= _DASH_LONGEST)
    bar &= parts.long >= _DASH_SHORTEST
    chosen = _longest_of_each(strokes, bar)
    out = np.zeros(len(strokes), dtype=bool)
    if len(chosen) < _DASH_MEMBERS:
        return out
    tips = strokes.ends[chosen].reshape(-1, 2) * metres_per_px
    heading = np.stack([-strokes.direction[chosen], strokes.direction[chosen]], axis=1).reshape(-1, 2)
    pairs = cKDTree(tips).query_pairs(_DASH_GAP, output_type="ndarray")
    pairs = pairs[pairs[:, 0] // 2 != pairs[:, 1] // 2]
    length = strokes.length[chosen] * metres_per_px
    linked: list[list[int]] = [[] for _ in chosen]
    for a, b in pairs.tolist():
        gap = tips[b] - tips[a]
        lead = a if length[a // 2] >= length[b // 2] else b
        aside = abs(gap[0] * heading[lead, 1] - gap[1] * heading[lead, 0])
        ahead = abs(gap @ heading[lead])
        if aside <= max(0.05, 2 * metres_per_px) + 0.12 * ahead:
            linked[a // 2].append(b // 2)
            linked[b // 2].append(a // 2)
    seen = np.zeros(len(chosen), dtype=bool)
    for start in range(len(chosen)):
        if not seen[start]:
            chain = _reachable(start, linked, seen)
            if len(chain) >= _DASH_MEMBERS:
                out |= np.isin(strokes.part, strokes.part[chosen[chain]])
    return out


def _longest_of_each(strokes: Strokes, wanted: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the index of the longest stroke of each wanted part."""
    order = np.lexsort((-strokes.length, strokes.part))
    first = order[np.append(True, np.diff(strokes.part[order]) != 0)] if len(order) else order
    return np.asarray(first[wanted[strokes.part[first]]], dtype=np.intp)


def _reachable(start: int, linked: list[list[int]], seen: NDArray[np.bool_]) -> list[int]:
    chain, queue = [], [start]
    seen[start] = True
    while queue:
        at = queue.pop()
        chain.append(at)
        for other in linked[at]:
            if not seen[other]:
                seen[other] = True
                queue.append(other)
    return chain


def wall_pen(strokes: Strokes, pairs: Pairs, candidates: NDArray[np.bool_], metres_per_px: float) -> float:
    """Return the weight of the pen that draws walls: the heavy end of the long strokes that come in pairs."""
    length = strokes.length * metres_per_px
    good = (pairs.overlap >= 0.8) & candidates[pairs.first] & candidates[pairs.second]
    members = np.unique(np.concatenate([pairs.first[good], pairs.second[good]]))
    if not len(members):
        members = np.flatnonzero(candidates & (length >= 1.0))
    if not len(members):
        return 0.0
    order = members[np.argsort(strokes.weight[members], kind="stable")]
    share = np.cumsum(length[order]) / length[order].sum()
    return float(strokes.weight[order[np.searchsorted(share, 0.6)]])


def light_pen(strokes: Strokes, pen: float) -> NDArray[np.bool_]:
    """Return which strokes a clearly lighter pen drew: furniture, dimension lines, hatches."""
    return np.asarray(strokes.weight < _LIGHT_PEN * pen, dtype=np.bool_)
