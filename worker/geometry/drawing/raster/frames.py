"""The frame of a sheet, and the title block that is built onto it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.raster.parts import Parts
from worker.geometry.drawing.raster.strokes import Strokes

_SPAN, _SIDE_COVERED, _STRAIGHT = 0.85, 0.7, 0.01
_PLAN_SPAN = 0.25
_ROUNDS, _MARGIN, _CLEAR = 3, 0.08, 0.012


def frames(strokes: Strokes, parts: Parts) -> NDArray[np.bool_]:
    """Return which strokes belong to a frame: a free rectangle near the sheet's edge, around everything else.

    A double frame is found from the outside inwards. The title block hangs on the frame and goes with it;
    a plan that touches the frame does not. The face of an outer wall is no frame: the other one is too near.
    """
    out = np.zeros(len(strokes), dtype=bool)
    gone = np.zeros(len(parts.long), dtype=bool)
    gone[0] = True
    found: list[int] = []
    while len(found) < _ROUNDS and (part := _outermost(strokes, parts, gone)) is not None:
        gone[part] = True
        found.append(part)
    if found and _stands_off(parts, found, gone):
        out |= np.isin(strokes.part, found)
    return out


def _stands_off(parts: Parts, found: list[int], gone: NDArray[np.bool_]) -> bool:
    """Return whether the rectangles lie near the sheet's edge, and well away from all that they surround."""
    sheet = np.array(parts.labels.shape[::-1], dtype=np.float64)
    low, high = _limits(parts, np.array(found))
    inner_low, inner_high = _limits(parts, np.flatnonzero(~gone))
    innermost = parts.box[found[-1]].astype(np.float64)
    gap = min((inner_low - innermost[:2]).min(), (innermost[:2] + innermost[2:] - inner_high).min())
    margin = max((low / sheet).max(), ((sheet - high) / sheet).max())
    return bool(margin <= _MARGIN and gap >= _CLEAR * float(sheet.max()))


def _limits(parts: Parts, which: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper corner of the box around some parts [working px]."""
    box = parts.box[which].astype(np.float64)
    return box[:, :2].min(axis=0), (box[:, :2] + box[:, 2:]).max(axis=0)


def _outermost(strokes: Strokes, parts: Parts, gone: NDArray[np.bool_]) -> int | None:
    """Return the part that frames all others, if one does."""
    box = parts.box.astype(np.float64)
    left = np.flatnonzero(~gone)
    if len(left) < 2:
        return None
    low, high = _limits(parts, left)
    size = box[left, 2:] / np.maximum(high - low, 1.0)
    first = int(np.argmax(size.min(axis=1)))
    part = int(left[first])
    others = np.delete(size, first, axis=0)
    if size[first].min() < _SPAN or others.min(axis=1).max(initial=0.0) < _PLAN_SPAN:
        return None
    own = strokes.take(strokes.part == part)
    return part if _is_rectangle(own, box[part, :2], box[part, :2] + box[part, 2:] - 1.0) else None


def _is_rectangle(own: Strokes, low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Return whether strokes run along all four sides of the box, and fill little else of the sheet."""
    slack = _STRAIGHT * float((high - low).max()) + 2.0
    along_sides = np.zeros(len(own), dtype=bool)
    for axis, limit in ((0, low), (0, high), (1, low), (1, high)):
        beside = (np.abs(own.ends[:, :, axis] - limit[axis]) <= slack).all(axis=1)
        along_sides |= beside
        if own.length[beside].sum() < _SIDE_COVERED * (high - low)[1 - axis]:
            return False
    inner = own.length[~along_sides].sum()
    return bool(inner <= own.length[along_sides].sum())
