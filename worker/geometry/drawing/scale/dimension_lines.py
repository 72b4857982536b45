"""The dimension line of a text: the parallel line beside it, followed to its ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.scale.text_lines import TextLine

_SIDE, _CLEAR = 2.6, 3.0
_TILTS = np.radians(np.arange(-4.0, 4.01, 0.5))
_RIDGE, _MOST_RIDGES = 0.8, 4
_TRACK, _LEAST_GAP, _GAP = 3, 6, 0.45
_MOST_LENGTH = 12_000
_CENTRED, _CENTRED_SHARE = 0.75, 0.04
_TICK, _MOST_WIDTH = 0.75, 0.55
_SPIKE_SHARE, _MARK_SHARE = 0.75, 0.16
_MOST_SPANS, _MOST_ENDS = 4, 40


@dataclass(frozen=True)
class Span:
    """Hold one stretch of a dimension line between two ends, with the text over its middle.

    Parameters
    ----------
    length : float
        Working pixels.
    quality : float
        0 to 1: ends with a tick or an arrow and an extension line are surest.
    start, end : tuple of float
        Working pixels, y down.
    """

    length: float
    quality: float
    start: tuple[float, float]
    end: tuple[float, float]


@dataclass(frozen=True)
class _End:
    """Hold a place where something crosses or ends a line: where along it, and how sure it bounds it."""

    at: float
    quality: float


def find_spans(lines: NDArray[np.uint8], text: TextLine) -> tuple[Span, ...]:
    """Return the stretches of parallel lines beside a text over whose middle it stands, the surest first.

    Parameters
    ----------
    lines : ndarray of shape (h, w), uint8
        The ink, 1 where a line is drawn; without the letters.
    text : TextLine
        In the same pixels.
    """
    spans: list[Span] = []
    for point, direction in _ridges(lines, text):
        tracked = _follow(lines, point, direction, text)
        if tracked is not None:
            spans += _centred(lines, text, *tracked)
    spans.sort(key=lambda s: (-s.quality, s.length))
    kept: list[Span] = []
    for span in spans:
        if all(abs(span.length - k.length) > max(2.0, 0.01 * k.length) for k in kept):
            kept.append(span)
    return tuple(kept[:_MOST_SPANS])


def _sample(mask: NDArray[np.uint8], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the mask at points, False outside of it."""
    columns, rows = np.rint(x).astype(np.int64), np.rint(y).astype(np.int64)
    inside = (columns >= 0) & (rows >= 0) & (columns < mask.shape[1]) & (rows < mask.shape[0])
    out = np.zeros(x.shape, dtype=np.bool_)
    out[inside] = mask[rows[inside], columns[inside]] > 0
    return out


def _ridges(
    lines: NDArray[np.uint8], text: TextLine
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Return a point and the direction of each line that runs beside or through a text, nearest first."""
    side = _SIDE * text.height
    reach = math.ceil(text.width / 2 + _CLEAR * text.height)
    t = np.arange(-reach, reach + 1.0)
    offsets = np.arange(-math.ceil(side), math.ceil(side) + 1, dtype=np.float64)
    outside = np.abs(t) > text.width / 2 + 0.3 * text.height
    best = np.zeros(len(offsets))
    tilt = np.zeros(len(offsets))
    for lean in _TILTS:
        a = text.angle + lean
        x = text.x + t[None, :] * math.cos(a) - offsets[:, None] * math.sin(a)
        y = text.y + t[None, :] * math.sin(a) + offsets[:, None] * math.cos(a)
        ink = _sample(lines, x, y)
        ink[:-1] |= ink[1:]
        through = np.abs(offsets) < 0.6 * text.height
        share = np.where(through, ink[:, outside].mean(axis=1), ink.mean(axis=1))
        better = share > best + 1e-9
        best[better], tilt[better] = share[better], lean
    found: list[tuple[float, NDArray[np.float64], NDArray[np.float64]]] = []
    for i in np.argsort(np.abs(offsets), kind="stable"):
        near = slice(max(0, i - 2), i + 3)
        if best[i] >= _RIDGE and best[i] >= best[near].max() and len(found) < _MOST_RIDGES:
            a = text.angle + tilt[i]
            point = np.array([text.x - offsets[i] * math.sin(a), text.y + offsets[i] * math.cos(a)])
            if all(abs(offsets[i] - o) > 3 for o, _, _ in found):
                found.append((offsets[i], point, np.array([math.cos(a), math.sin(a)])))
    return [(point, direction) for _, point, direction in found]


def _follow(
    lines: NDArray[np.uint8], point: NDArray[np.float64], along: NDArray[np.float64], text: TextLine
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, float] | None:
    """Return a point and the direction of a line, fitted to its ink, and how far it goes to both sides."""
    gap = max(_LEAST_GAP, _GAP * text.height)
    bridge = text.width / 2 + 0.8 * text.height
    reach = text.width / 2 + _CLEAR * text.height
    low = high = 0.0
    while True:
        t = np.arange(-reach, reach + 1.0)
        across = np.array([-along[1], along[0]])
        o = np.arange(-_TRACK, _TRACK + 1.0)
        xy = point[:, None, None] + along[:, None, None] * t[None, :, None] + across[:, None, None] * o
        ink = _sample(lines, xy[0], xy[1])
        thick = ink.sum(axis=1)
        hit = (thick > 0) & (thick < 2 * _TRACK + 1)
        seen = thick > 0
        low, high = _run(t, seen, gap=gap, bridge=bridge)
        inside = hit & (t >= low) & (t <= high)
        if inside.sum() < max(8.0, text.height):
            return None
        middle = (ink * o).sum(axis=1)[inside] / thick[inside]
        slope, shift = _robust_line(t[inside], middle)
        point = point + across * shift
        along = along + across * slope
        along = along / np.hypot(*along)
        if (low > -reach + gap and high < reach - gap) or reach >= _MOST_LENGTH:
            return point, along, low, high
        reach = min(2.0 * reach, _MOST_LENGTH)


def _run(
    t: NDArray[np.float64], seen: NDArray[np.bool_], *, gap: float, bridge: float
) -> tuple[float, float]:
    """Return from where to where a line runs around 0: gaps are bridged, under the text longer ones."""
    ends = []
    for sign in (-1.0, 1.0):
        at = np.sort(sign * t[seen & (sign * t >= 0)])
        if not len(at) or at[0] > bridge + gap:
            ends.append(0.0)
            continue
        breaks = np.flatnonzero((np.diff(at) > gap + 1) & (at[1:] > bridge + gap))
        ends.append(float(sign * (at[breaks[0]] if len(breaks) else at[-1])))
    return ends[0], ends[1]


def _robust_line(t: NDArray[np.float64], o: NDArray[np.float64]) -> tuple[float, float]:
    """Return slope and value at 0 of a line through most of the points."""
    keep = np.full(len(t), fill_value=True)
    slope = shift = 0.0
    for _ in range(3):
        if keep.sum() < 2 or np.ptp(t[keep]) < 1:
            break
        slope, shift = np.polyfit(t[keep], o[keep], 1)
        off = np.abs(o - slope * t - shift)
        keep = off <= max(0.6, 2.5 * float(np.median(off)))
    return float(slope), float(shift)


def _centred(
    lines: NDArray[np.uint8],
    text: TextLine,
    point: NDArray[np.float64],
    along: NDArray[np.float64],
    low: float,
    high: float,
) -> list[Span]:
    """Return the stretches between two ends of a line whose middle is the text's middle."""
    middle = float((np.array([text.x, text.y]) - point) @ along)
    ends = _ends(lines, text, point, along, low, high)
    left = [e for e in ends if e.at < middle - 0.3 * text.height][::-1][:_MOST_ENDS]
    right = [e for e in ends if e.at > middle + 0.3 * text.height][:_MOST_ENDS]
    out = []
    for i, a in enumerate(left):
        for j, b in enumerate(right):
            length = b.at - a.at
            off = abs((a.at + b.at) / 2 - middle)
            if off > max(_CENTRED * text.height, _CENTRED_SHARE * length) or length < 1.2 * text.height:
                continue
            passed = [e.quality for e in left[:i] + right[:j]]
            quality = min(a.quality, b.quality) * (1.0 - max(passed, default=0.0)) ** 1.5
            quality *= 1.0 - 0.5 * off / max(_CENTRED * text.height, _CENTRED_SHARE * length)
            if quality > 0.05:
                start, end = point + along * a.at, point + along * b.at
                out.append(Span(length, quality, (start[0], start[1]), (end[0], end[1])))
    return out


def _ends(
    lines: NDArray[np.uint8],
    text: TextLine,
    point: NDArray[np.float64],
    along: NDArray[np.float64],
    low: float,
    high: float,
) -> list[_End]:
    """Return where lines cross or touch a line, where ticks and arrows sit on it, and where it stops."""
    reach = max(6.0, _TICK * text.height)
    t = np.arange(low - reach, high + reach + 1.0)
    o = np.arange(-math.ceil(reach), math.ceil(reach) + 1.0)
    across = np.array([-along[1], along[0]])
    xy = point[:, None, None] + along[:, None, None] * t[None, :, None] + across[:, None, None] * o
    ink = _sample(lines, xy[0], xy[1])
    own = max(1.0, float(np.median(_thickness(ink, o)[(t >= low) & (t <= high)])))
    beside = np.abs(o) > own / 2 + 1.0
    if not (beside & (o < 0)).any() or not (beside & (o > 0)).any():
        return []  # as thick as the text is tall: no dimension line
    steady = ink.copy()
    steady[1:] |= ink[:-1]
    steady[:-1] |= ink[1:]
    up = steady[:, beside & (o < 0)].mean(axis=1)
    down = steady[:, beside & (o > 0)].mean(axis=1)
    crossing = np.maximum(up, down) >= _SPIKE_SHARE
    marks = ink[:, beside & (np.abs(o) <= 0.5 * reach)].sum(axis=1)
    out = [
        _End(
            at,
            _quality(t, marks, at, crossing=True, stop=min(abs(at - low), abs(at - high)) < reach, own=own),
        )
        for at in _spikes(t, crossing, widest=max(6.0, _MOST_WIDTH * text.height))
    ]
    for at in (low, high):
        if all(abs(e.at - at) > 0.8 * reach for e in out):
            out.append(_End(at, _quality(t, marks, at, crossing=False, stop=True, own=own)))
    return sorted(out, key=lambda e: e.at)


def _thickness(ink: NDArray[np.bool_], o: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how thick a line is at each place: ink that hangs together around its middle."""
    middle = len(o) // 2
    below = np.cumprod(ink[:, middle:], axis=1).sum(axis=1)
    above = np.cumprod(ink[:, : middle + 1][:, ::-1], axis=1).sum(axis=1)
    return np.asarray(np.maximum(below + above - 1, 0), dtype=np.float64)


def _spikes(t: NDArray[np.float64], crossing: NDArray[np.bool_], *, widest: float) -> list[float]:
    """Return the middles of the narrow runs where something crosses."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], crossing.astype(np.int8), [0]])))
    return [
        float((t[a] + t[b - 1]) / 2)
        for a, b in zip(edges[::2], edges[1::2], strict=True)
        if t[b - 1] - t[a] <= widest
    ]


def _quality(
    t: NDArray[np.float64], marks: NDArray[np.int64], at: float, *, crossing: bool, stop: bool, own: float
) -> float:
    """Return how sure something at a place bounds a dimension: a mark, a line across, the line's own end."""
    beside = (np.abs(t - at) > own / 2 + 2.0) & (np.abs(t - at) <= 12.0)
    ink = float((marks[beside] > 0).mean()) if beside.any() else 0.0
    marked = ink >= _MARK_SHARE
    return 0.25 + 0.3 * marked + 0.25 * crossing + 0.2 * stop - 0.3 * (not crossing and not marked)
