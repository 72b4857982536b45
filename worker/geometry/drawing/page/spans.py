"""Dimension lines of a vector page: the stretches between ticks that a text names the length of."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.scale.dimension_lines import Span
from worker.geometry.drawing.text import Text

_PARALLEL = math.sin(math.radians(1.0))
_FARTHEST_LINE, _SAME_LINE, _TOUCH = 3.0, 0.15, 0.35
_LONGEST = 400.0
_GAP = 1.2
_NEAREST = 3
_OFF_CENTRE = 0.18
_MOST_SPANS = 4
_LETTER = 0.8


@dataclass(frozen=True, eq=False)
class StrokeIndex:
    """Hold the strokes that dimension lines can be made of: all that are not filled.

    Parameters
    ----------
    ends : ndarray of shape (S, 2, 2), float64
        In the unit of the page.
    step : ndarray of shape (S, 2), float64
        Unit direction.
    """

    ends: NDArray[np.float64]
    step: NDArray[np.float64]

    @classmethod
    def of(cls, linework: Linework) -> StrokeIndex:
        """Return the index of a page."""
        ends = linework.ends[~linework.filled[linework.entity]]
        step = ends[:, 1] - ends[:, 0]
        length = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-12)
        return cls(ends, step / length[:, None])


def page_spans(index: StrokeIndex, text: Text) -> tuple[Span, ...]:
    """Return the stretches of lines along a text that its number may be the length of, the surest first.

    A dimension line runs along the text, at most three letters' height away or broken around it, and what
    crosses or touches it (ticks, extension lines, walls) bounds the stretch; the text stands over its middle.

    Parameters
    ----------
    index : StrokeIndex
        Strokes of the page.
    text : Text
        In the page's unit, y up.

    Returns
    -------
    tuple of Span
        In the page's unit.
    """
    h = text.height
    if not h > 0:
        return ()
    along = np.array([math.cos(text.angle), math.sin(text.angle)])
    across = np.array([-along[1], along[0]])
    local = index.ends - (text.x, text.y)
    t, o = local @ along, local @ across
    near = (o.min(axis=1) <= _FARTHEST_LINE * h) & (o.max(axis=1) >= -_FARTHEST_LINE * h)
    near &= (t.min(axis=1) <= _LONGEST * h) & (t.max(axis=1) >= -_LONGEST * h)
    t, o, step = t[near], o[near], index.step[near]
    parallel = np.abs(step @ across) <= _PARALLEL
    half_text = 0.5 * _LETTER * h * len(text.text)
    out: list[Span] = []
    for offset in _offsets(o[parallel], h):
        same = parallel & (np.abs(o.mean(axis=1) - offset) <= _SAME_LINE * h)
        line = _stretch(t[same], half_text + _GAP * h)
        if line is None:
            continue
        marks = _marks(t, o, ~parallel, offset=offset, reach=_TOUCH * h, line=line)
        out += _between(marks, line, offset, (text, along, across))
    out.sort(key=lambda s: -s.quality)
    return tuple(out[:_MOST_SPANS])


def _offsets(o: NDArray[np.float64], h: float) -> list[float]:
    """Return at which distances from the text lines run along it, the nearest first."""
    found: list[float] = []
    for value in sorted(o.mean(axis=1).tolist(), key=abs):
        if abs(value) > _FARTHEST_LINE * h:
            break
        if all(abs(value - f) > _SAME_LINE * h for f in found):
            found.append(value)
        if len(found) == _MOST_SPANS:
            break
    return found


def _stretch(t: NDArray[np.float64], gap: float) -> tuple[float, float] | None:
    """Return from where to where pieces of one line run past the text, which may break it, or None."""
    pieces = np.sort(t, axis=1)
    pieces = pieces[np.argsort(pieces[:, 0])]
    low = high = None
    for a, b in pieces:
        if low is None or high is None or a > high + (gap * 2 if high < 0 < a or high <= gap else 1e-3 * gap):
            if high is not None and low is not None and low <= gap and high >= -gap and low < 0 < high:
                break
            low, high = float(a), float(b)
        else:
            high = max(high, float(b))
    if low is None or high is None or not low < 0 < high:
        return None
    return low, high


def _marks(
    t: NDArray[np.float64],
    o: NDArray[np.float64],
    crossing: NDArray[np.bool_],
    *,
    offset: float,
    reach: float,
    line: tuple[float, float],
) -> NDArray[np.float64]:
    """Return where strokes cross or touch a line, in order, each place once."""
    T, O = t[crossing], o[crossing] - offset  # noqa: E741
    touches = (O.min(axis=1) <= reach) & (O.max(axis=1) >= -reach)
    T, O = T[touches], O[touches]  # noqa: E741
    drop = O[:, 1] - O[:, 0]
    share = np.clip(np.divide(-O[:, 0], drop, out=np.zeros_like(drop), where=drop != 0), 0.0, 1.0)
    at = T[:, 0] + share * (T[:, 1] - T[:, 0])
    at = np.sort(at[(at >= line[0] - reach) & (at <= line[1] + reach)])
    if not len(at):
        return at
    first = np.concatenate([[True], np.diff(at) > 0.25 * reach])
    group = np.cumsum(first) - 1
    return np.asarray(np.bincount(group, weights=at) / np.bincount(group), dtype=np.float64)


def _between(
    marks: NDArray[np.float64],
    line: tuple[float, float],
    offset: float,
    frame: tuple[Text, NDArray[np.float64], NDArray[np.float64]],
) -> list[Span]:
    """Return the stretches between marks left and right of the text's middle, by how well it is centred."""
    text, along, across = frame
    h = text.height
    ends = [(float(m), 1.0) for m in marks]
    ends += [(e, 0.6) for e in line if not len(marks) or np.abs(marks - e).min() > 0.5 * h]
    left = sorted((e for e in ends if e[0] < -0.2 * h), reverse=True)[:_NEAREST]
    right = sorted(e for e in ends if e[0] > 0.2 * h)[:_NEAREST]
    origin = np.array([text.x, text.y])
    out = []
    for a, sure_a in left:
        for b, sure_b in right:
            off = abs(a + b) / 2 / (b - a)
            if off > _OFF_CENTRE or b - a < 0.8 * h:
                continue
            quality = min(sure_a, sure_b) * (1.0 - 2.5 * off) * (1.0 if abs(offset) <= 2 * h else 0.8)
            p, q = (tuple(origin + along * v + across * offset) for v in (a, b))
            out.append(Span(b - a, quality, (float(p[0]), float(p[1])), (float(q[0]), float(q[1]))))
    return out
