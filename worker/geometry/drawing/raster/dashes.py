"""Dashed and dash-dot lines: free bars in a row, also thick ones that bend with the line."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.raster.parts import Parts
from worker.geometry.drawing.raster.strokes import Strokes

_THICKEST = 0.25
_LONGEST, _SHORTEST = 6.0, 0.06
_GAP, _GAP_OF_DASH = 0.6, 0.9
_MEMBERS = 4
_USUAL = 2.0
_SOLID = 0.55
_MOST_PIECES = 12
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
    tips = _tips(strokes, parts, chosen, metres_per_px)
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
    """Return the parts that are one bar: solid and straight, or bent and no more ink than one line has."""
    whole = np.bincount(strokes.part, strokes.length * metres_per_px, len(parts.long))
    width = parts.area / np.maximum(whole, metres_per_px)
    thin = max(_THICKEST, 3 * metres_per_px)
    bar = (whole > 0) & (parts.long >= _SHORTEST) & (parts.long <= _LONGEST)
    bent = (width <= thin) & (parts.long >= 1.3 * np.minimum(width, parts.long))
    bent &= (whole <= 1.15 * parts.long + parts.short + 2 * width) & ~parts.hollow
    return np.asarray(np.flatnonzero(bar & (bent | _straight(parts, metres_per_px))), dtype=np.int64)


def _straight(parts: Parts, metres_per_px: float) -> NDArray[np.bool_]:
    solid = (parts.fill >= _SOLID) | (parts.short <= 4 * metres_per_px)
    thin = parts.short <= max(_THICKEST, 3 * metres_per_px)
    return np.asarray(solid & thin & (parts.long >= 1.3 * parts.short), dtype=np.bool_)


def _tips(strokes: Strokes, parts: Parts, chosen: NDArray[np.int64], metres_per_px: float) -> _Tips:
    """Return the two ends of each chosen part that lie farthest from each other."""
    order = np.argsort(strokes.part, kind="stable")
    low, high = (np.searchsorted(strokes.part[order], chosen, side) for side in ("left", "right"))
    straight = _straight(parts, metres_per_px)[chosen]
    half = parts.axis[chosen] * (parts.long[chosen] / 2)[:, None]
    at = np.stack([-half, half], axis=1) + (parts.middle[chosen] * metres_per_px)[:, None]
    heading = np.stack([-parts.axis[chosen], parts.axis[chosen]], axis=1)
    for n in np.flatnonzero(~straight & (high - low <= _MOST_PIECES)):
        own = order[low[n] : high[n]]
        ends = strokes.ends[own].reshape(-1, 2)
        out = np.stack([-strokes.direction[own], strokes.direction[own]], axis=1).reshape(-1, 2)
        far = ((ends[:, None] - ends[None]) ** 2).sum(axis=2)
        pair = np.array(np.unravel_index(int(far.argmax()), far.shape))
        more = out[pair] * (strokes.width[own[pair // 2]] / 2.0)[:, None]
        at[n] = (ends[pair] + more) * metres_per_px
        heading[n] = out[pair]
    return _Tips(at.reshape(-1, 2), heading.reshape(-1, 2), np.repeat(np.arange(len(chosen)), 2))


def _links(
    tips: _Tips, size: NDArray[np.float64], width: NDArray[np.float64], metres_per_px: float
) -> list[list[int]]:
    """Return for each dash those that go on where it ends."""
    linked: list[list[int]] = [[] for _ in size]
    pairs = cKDTree(tips.at).query_pairs(_GAP, output_type="ndarray")
    a, b = pairs[tips.dash[pairs[:, 0]] != tips.dash[pairs[:, 1]]].T
    i, j = tips.dash[a], tips.dash[b]
    first = size[i] >= size[j]
    lead, other = np.where(first, a, b), np.where(first, b, a)
    gap, toward = tips.at[other] - tips.at[lead], tips.heading[lead]
    ahead = (gap * toward).sum(axis=1)
    aside = np.abs(gap[:, 0] * toward[:, 1] - gap[:, 1] * toward[:, 0])
    good = np.maximum(width[i], width[j]) <= _SAME_WIDTH * np.minimum(width[i], width[j]) + metres_per_px
    good &= ahead <= np.maximum(_GAP_OF_DASH * np.maximum(size[i], size[j]), 2 * metres_per_px)
    good &= (-metres_per_px <= ahead) & (aside <= max(0.05, 2 * metres_per_px) + 0.15 * ahead)
    for one, two in zip(i[good].tolist(), j[good].tolist(), strict=True):
        linked[one].append(two)
        linked[two].append(one)
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
