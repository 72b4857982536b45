"""Dashed and dash-dot lines: free bars in a row, also thick ones that bend with the line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.parts import Parts
from worker.geometry.drawing.strokes import Strokes

_THICKEST = 0.25
_LONGEST, _SHORTEST = 6.0, 0.06
_GAP, _GAP_OF_DASH = 0.6, 0.9
_MEMBERS = 4
_USUAL = 2.0
_OPENING = 0.8
_SAME_WIDTH = 1.7


class _Tips(NamedTuple):
    """Hold the two tips of each of the D dashes: where (2 D, 2), which way they point, and whose they are."""

    at: NDArray[np.float64]
    heading: NDArray[np.float64]
    dash: NDArray[np.int64]


def dashed(strokes: Strokes, parts: Parts, metres_per_px: float) -> NDArray[np.bool_]:
    """Return which strokes are dashes: free bars in a row of at least four, with gaps of up to 60 cm.

    Dashed lines show what is not at walking height: roof edges, beams, site limits, doors in planning. A
    bar may bend, and may be thick; the bars of a row are equally thick, and half of the gaps in it are
    shorter than the bars beside them.
    """
    out = np.zeros(len(strokes), dtype=bool)
    chosen = _bars(strokes, parts, metres_per_px)
    if len(chosen) < _MEMBERS:
        return out
    tips = _tips(strokes, chosen, metres_per_px)
    size = parts.long[chosen]
    linked = _links(tips, size, parts.area[chosen] / np.maximum(size, 1e-9), metres_per_px)
    seen = np.zeros(len(chosen), dtype=bool)
    for start in range(len(chosen)):
        if seen[start]:
            continue
        chain = _reachable(start, linked, seen)
        if len(chain) >= _MEMBERS and float(np.median(size[chain])) <= _USUAL:
            out |= np.isin(strokes.part, chosen[chain])
    return out


def _bars(strokes: Strokes, parts: Parts, metres_per_px: float) -> NDArray[np.int64]:
    """Return the parts that are one bar, straight or bent: as much ink as their length times their width."""
    whole = np.bincount(strokes.part, strokes.length * metres_per_px, len(parts.long))
    width = parts.area / np.maximum(whole, metres_per_px)
    bar = (whole > 0) & (parts.long >= _SHORTEST) & (whole <= _LONGEST)
    bar &= (width <= max(_THICKEST, 3 * metres_per_px)) & (parts.long >= 1.3 * np.minimum(width, parts.long))
    bar &= (whole <= 1.15 * parts.long + parts.short + 2 * width) & ~parts.hollow
    return np.asarray(np.flatnonzero(bar), dtype=np.int64)


def _tips(strokes: Strokes, chosen: NDArray[np.int64], metres_per_px: float) -> _Tips:
    """Return the two ends of each chosen part that lie farthest from each other."""
    order = np.argsort(strokes.part, kind="stable")
    low, high = (np.searchsorted(strokes.part[order], chosen, side) for side in ("left", "right"))
    at, heading = [], []
    for a, b in zip(low.tolist(), high.tolist(), strict=True):
        own = order[a:b]
        ends = strokes.ends[own].reshape(-1, 2)
        out = np.stack([-strokes.direction[own], strokes.direction[own]], axis=1).reshape(-1, 2)
        far = ((ends[:, None] - ends[None]) ** 2).sum(axis=2) if len(own) <= _MOST_PIECES else None
        i, j = (0, 1) if far is None else np.unravel_index(int(far.argmax()), far.shape)
        for k in (i, j):
            more = out[k] * float(strokes.width[own[int(k) // 2]]) / 2.0
            at.append((ends[k] + more) * metres_per_px)
            heading.append(out[k])
    return _Tips(np.array(at), np.array(heading), np.repeat(np.arange(len(chosen)), 2))


_MOST_PIECES = 12


def _links(
    tips: _Tips, size: NDArray[np.float64], width: NDArray[np.float64], metres_per_px: float
) -> list[list[int]]:
    """Return for each dash those that go on where it ends."""
    linked: list[list[int]] = [[] for _ in size]
    pairs = cKDTree(tips.at).query_pairs(_GAP, output_type="ndarray")
    pairs = pairs[tips.dash[pairs[:, 0]] != tips.dash[pairs[:, 1]]]
    for a, b in pairs.tolist():
        i, j = int(tips.dash[a]), int(tips.dash[b])
        lead = a if size[i] >= size[j] else b
        gap = tips.at[b] - tips.at[a] if lead == a else tips.at[a] - tips.at[b]
        toward = tips.heading[lead]
        ahead, aside = float(gap @ toward), abs(float(gap[0] * toward[1] - gap[1] * toward[0]))
        alike = max(width[i], width[j]) <= _SAME_WIDTH * min(width[i], width[j]) + metres_per_px
        short = ahead <= max(_GAP_OF_DASH * max(size[i], size[j]), 2 * metres_per_px)
        if alike and short and -metres_per_px <= ahead and aside <= max(0.05, 2 * metres_per_px) + 0.15 * ahead:
            linked[i].append(j)
            linked[j].append(i)
    return linked


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
