"""Pens: how heavy each stroke was drawn, and which of a drawing's pens draws its walls."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.raster.ink import Ink
from worker.geometry.drawing.raster.pairs import Pairs
from worker.geometry.drawing.raster.strokes import Strokes

_REACH_PX = 7
_FOOT = 0.3
_PLACES = 9
_CUT_SHORTEST, _CUT_STEP, _CUT_LEAST_CELLS = 0.3, 0.05, 3
_STEP = 0.06
_SHORTEST, _SIDE_BY_SIDE, _NARROWEST = 0.4, 0.5, 0.07
_LEAST_SPAN, _LEAST_PAIRED, _LEAST_SHARE, _BETTER = 0.55, 0.1, 0.4, 0.1
_LIGHT, _HEAVY_END = 0.6, 0.6
_MOSTLY_PAIRED, _SET_OFF, _PEN_STEPS = 0.5, 0.6, 4
_LEAST_OF_ALL = 0.05
_ALIKE = 1.34
_ONE_PEN = float(np.log(1.4))


def weigh(ink: Ink, strokes: Strokes, *, places: int = _PLACES) -> Strokes:
    """Return the strokes with `weight` measured anew: darkness summed across each, its neighbours left out.

    Notes
    -----
    The profile across a stroke is taken at some places and summed from its middle outwards, up to where it
    falls under 30 % of its peak; the weight is their median. Two lines 3 px apart so keep their
    own weights.
    """
    if not len(strokes):
        return strokes
    share = np.linspace(0.08, 0.92, places)
    along = strokes.ends[:, 1] - strokes.ends[:, 0]
    at = (strokes.ends[:, :1] + along[:, None] * share[None, :, None]).reshape(-1, 2)
    normal = np.column_stack([-strokes.direction[:, 1], strokes.direction[:, 0]])
    weight = _hills(ink.contrast, at, np.repeat(normal, places, axis=0)).reshape(len(strokes), places)
    return replace(strokes, weight=np.asarray(np.median(weight, axis=1), dtype=np.float64))


@numba.njit(cache=True)
def _hills(  # pragma: no cover - compiled
    contrast: NDArray[np.uint8], at: NDArray[np.float64], normal: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the sum of the profile across each point over its central hill."""
    height, width = contrast.shape
    size = 2 * _REACH_PX + 1
    out = np.zeros(len(at))
    profile = np.zeros(size)
    for k in range(len(at)):
        for n in range(size):
            x = min(max(at[k, 0] + normal[k, 0] * (n - _REACH_PX), 0.0), width - 1.0)
            y = min(max(at[k, 1] + normal[k, 1] * (n - _REACH_PX), 0.0), height - 1.0)
            i, j = int(y), int(x)
            i1, j1 = min(i + 1, height - 1), min(j + 1, width - 1)
            v, u = y - i, x - j
            top = contrast[i, j] * (1.0 - u) + contrast[i, j1] * u
            profile[n] = top * (1.0 - v) + (contrast[i1, j] * (1.0 - u) + contrast[i1, j1] * u) * v
        peak = _REACH_PX - 2
        for n in range(_REACH_PX - 1, _REACH_PX + 3):
            if profile[n] > profile[peak]:
                peak = n
        foot = _FOOT * profile[peak]
        out[k] = profile[peak]
        for step in (-1, 1):
            n = peak + step
            while 0 <= n < size and profile[n] >= foot:
                out[k] += profile[n]
                n += step
    return out


def split_where_lighter(ink: Ink, strokes: Strokes, least: float) -> tuple[Strokes, NDArray[np.int64]]:
    """Return the strokes cut where the pen gets lighter or heavier than `least`, and their origin.

    A window's sill may run on as the face of the wall beside it. A change counts that lasts at least 15 cm.
    """
    length = strokes.length * ink.metres_per_px
    long = length >= _CUT_SHORTEST
    if not long.any() or least <= 0.0:
        return strokes, np.arange(len(strokes), dtype=np.int64)
    count = np.where(long, np.ceil(length / _CUT_STEP), 1.0).astype(np.int64)
    owner = np.repeat(np.arange(len(strokes)), count)
    first = np.repeat(np.cumsum(count) - count, count)
    low = (np.arange(len(owner)) - first) / count[owner]
    high = low + 1.0 / count[owner]
    along = strokes.ends[owner, 1] - strokes.ends[owner, 0]
    start = strokes.ends[owner, 0]
    cells = Strokes(
        np.stack([start + along * low[:, None], start + along * high[:, None]], axis=1),
        strokes.width[owner],
        strokes.weight[owner],
        strokes.part[owner],
    )
    measured = weigh(ink, cells, places=3).weight
    heavy = _steady(np.where(long[owner], measured, strokes.weight[owner]) >= least, owner)
    begins = np.append(True, (np.diff(owner) != 0) | (heavy[1:] != heavy[:-1]))
    ends = np.append(np.flatnonzero(begins)[1:], len(owner)) - 1
    begin = np.flatnonzero(begins)
    whole = count[owner[begin]] == ends - begin + 1
    pieces = Strokes(
        np.stack([cells.ends[begin, 0], cells.ends[ends, 1]], axis=1),
        strokes.width[owner[begin]],
        strokes.weight[owner[begin]],
        strokes.part[owner[begin]],
    )
    cut = np.flatnonzero(~whole)
    weight = pieces.weight.copy()
    weight[cut] = weigh(ink, pieces.take(cut)).weight
    return replace(pieces, weight=weight), owner[begin]


def like_most(strokes: Strokes, faces: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which strokes were drawn with the pen of most `faces`: within a third of its weight.

    Without any face every stroke is.
    """
    if not faces.any():
        return np.full(len(strokes), fill_value=True)
    order = np.flatnonzero(faces)[np.argsort(strokes.weight[faces], kind="stable")]
    share = np.cumsum(strokes.length[order])
    usual = strokes.weight[order[int(np.searchsorted(share, 0.5 * share[-1]))]]
    return np.asarray((strokes.weight >= usual / _ALIKE) & (strokes.weight <= usual * _ALIKE), dtype=np.bool_)


def _steady(heavy: NDArray[np.bool_], owner: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the flags without runs, inside a stroke, of fewer than three cells."""
    begins = np.append(True, (np.diff(owner) != 0) | (heavy[1:] != heavy[:-1]))
    begin = np.flatnonzero(begins)
    run = np.cumsum(begins) - 1
    size = np.diff(np.append(begin, len(heavy)))
    inner = np.zeros(len(begin), dtype=bool)
    inner[1:] = owner[begin[1:]] == owner[begin[1:] - 1]
    flip = (size < _CUT_LEAST_CELLS) & (inner | np.append(inner[1:], False))
    return np.asarray(heavy ^ flip[run], dtype=np.bool_)


def lightest_wall_pen(
    strokes: Strokes, pairs: Pairs, candidates: NDArray[np.bool_], metres_per_px: float
) -> float:
    """Return the least weight of a stroke that may be a wall's.

    Draughtsmen cut walls with a heavier pen than what stands in the rooms. Of all pens (weights up to 1.4 of
    the least), those count that span the drawing and hold a fair part of all that runs in pairs at a wall's
    thickness. Of them the heaviest is taken that draws pairs mostly and is set off from what is lighter;
    else the one of which the largest share is paired, if that is clearly more than of all strokes. Where none
    is so good, what is under 60 % of the heavy end of the paired strokes is light.
    """
    length = strokes.length * metres_per_px
    use = candidates & (length >= _SHORTEST)
    if not use.any():
        return 0.0
    weight = np.log(np.maximum(strokes.weight, 1.0))
    cuts = np.arange(weight[use].min(), weight[use].max() + _STEP, _STEP)
    density = np.histogram(weight[use], np.append(cuts, cuts[-1] + _STEP), weights=length[use])[0]
    span = _span(strokes, use)
    least = max(_LEAST_PAIRED * paired_length(pairs, use, length), _LEAST_OF_ALL * float(length[use].sum()))
    shares, fair = np.zeros(len(cuts)), np.zeros(len(cuts), dtype=bool)
    for k, cut in enumerate(cuts):
        heavy = use & (weight >= cut)
        pen = heavy & ((weight <= cut + _ONE_PEN) | (k == 0))
        paired = paired_length(pairs, heavy, np.where(pen, length, 0.0))
        shares[k] = paired / max(float(length[pen].sum()), 1e-9)
        fair[k] = paired >= least and heavy.any() and (_span(strokes, heavy) >= _LEAST_SPAN * span).all()
    best = _heaviest_pen(density, shares, fair) or _most_paired_pen(shares, fair)
    if not best:
        return _LIGHT * _heavy_end(strokes, pairs, candidates, length)
    first = max(0, best - _PEN_STEPS)
    return float(np.exp(cuts[first + int(np.argmin(density[first : best + 1]))]))


def _heaviest_pen(density: NDArray[np.float64], shares: NDArray[np.float64], fair: NDArray[np.bool_]) -> int:
    """Return the cut of the heaviest fair pen that is half paired and set off from lighter ones, or 0.

    It is paired no less than all strokes are. Set off is a pen where little is drawn just under its weight:
    60 % at most of its own densest weight, and of the densest lighter one.
    """
    smooth = np.convolve(density, np.ones(3) / 3, mode="same")
    paired = np.where(fair, shares, -1.0)
    for k in np.flatnonzero(paired[1:] >= _MOSTLY_PAIRED)[::-1] + 1:
        low = max(0, k - 2)
        best = int(low + np.argmax(paired[low : k + 3]))
        first = max(0, best - _PEN_STEPS)
        gap = float(smooth[first : best + 1].min())
        beside = min(smooth[best : best + _PEN_STEPS + 2].max(), smooth[: first + 1].max())
        if shares[best] >= shares[0] and gap <= _SET_OFF * beside:
            return best
    return 0


def _most_paired_pen(shares: NDArray[np.float64], fair: NDArray[np.bool_]) -> int:
    """Return the cut of the fair pen of which most is paired, or 0 where that is hardly more than of all."""
    best = int(np.argmax(np.where(fair, shares, shares[0])))
    return best if shares[best] >= max(_LEAST_SHARE, shares[0] + _BETTER) else 0


def _span(strokes: Strokes, which: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return width and height of what the chosen strokes cover, without the outermost 2 %."""
    low, high = np.percentile(strokes.ends[which].reshape(-1, 2), [2, 98], axis=0)
    return np.asarray(high - low, dtype=np.float64)


def paired_length(pairs: Pairs, which: NDArray[np.bool_], length: NDArray[np.float64]) -> float:
    """Return the length of the chosen strokes that runs beside another of them [m]."""
    both = which[pairs.first] & which[pairs.second]
    both &= (pairs.overlap >= _SIDE_BY_SIDE) & (pairs.spacing >= _NARROWEST)
    beside = np.bincount(pairs.first[both], pairs.overlap[both], len(length))
    beside += np.bincount(pairs.second[both], pairs.overlap[both], len(length))
    return float(np.minimum(length, beside).sum())


def _heavy_end(
    strokes: Strokes, pairs: Pairs, candidates: NDArray[np.bool_], length: NDArray[np.float64]
) -> float:
    """Return the weight that 60 % of the length of the paired strokes does not exceed."""
    good = (pairs.overlap >= 0.8) & candidates[pairs.first] & candidates[pairs.second]
    members = np.unique(np.concatenate([pairs.first[good], pairs.second[good]]))
    if length[members].sum() < _LEAST_OF_ALL * length[candidates].sum():
        members = np.flatnonzero(candidates & (length >= 1.0))
    if not len(members):
        return 0.0
    order = members[np.argsort(strokes.weight[members], kind="stable")]
    share = np.cumsum(length[order]) / length[order].sum()
    return float(strokes.weight[order[np.searchsorted(share, _HEAVY_END)]])
