"""What of a vector page is no wall: frames, hatches, door swings and lighter pens, each with its reason."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.removed import Place, removed_strokes
from worker.geometry.drawing.linework.roles import Roles
from worker.geometry.drawing.reading.reading import RemovedStroke

_FRAME_SHARE, _BORDER = 0.8, 0.08
_QUARTER = (math.radians(60.0), math.radians(110.0))

_REASONS = {
    "frame": "It runs along most of a side of the page, near its edge: the frame.",
    "hatch": "It fills an area that has not the shape of walls.",
    "door": "It is a quarter of a circle: the swing of a door.",
    "light-pen": "It is drawn with a lighter pen than the walls.",
}


def set_aside(
    linework: Linework, roles: Roles, *, kept: NDArray[np.bool_], place: Place
) -> tuple[RemovedStroke, ...]:
    """Return every entity that is not `kept`, and every text, in its layer and with its reason.

    Parameters
    ----------
    linework : Linework
        A page.
    roles : Roles
        As what its layers and entities were taken; what these leave open is told by shape and pen.
    kept : ndarray of shape (E,), bool
        Entities that walls and columns account for.
    place : callable
        Turns (N, 2) points in drawing units into frame `drawing`.
    """
    removed = removed_strokes(linework, roles, kept=kept, place=place)
    present = np.zeros(len(linework.kind), dtype=np.bool_)
    present[linework.entity] = True
    numbers = np.flatnonzero(present & ~kept)
    shape = _shapes(linework, kept)
    strokes = [
        replace(stroke, layer=shape[e], reason=_REASONS[shape[e]])
        if stroke.layer == "other" and shape[e]
        else stroke
        for stroke, e in zip(removed, numbers.tolist(), strict=False)
    ]
    return (*strokes, *removed[len(numbers) :])


def frames(linework: Linework) -> NDArray[np.bool_]:
    """Return which of the E entities are lines along most of a side of the page: its frame."""
    out = np.zeros(len(linework.kind), dtype=np.bool_)
    if linework.sheet is None:
        return out
    left, bottom, right, top = linework.sheet
    span = np.abs(linework.ends[:, 1] - linework.ends[:, 0])
    long = (span[:, 0] >= _FRAME_SHARE * (right - left)) | (span[:, 1] >= _FRAME_SHARE * (top - bottom))
    middle = linework.ends.mean(axis=1)
    aside = np.minimum(
        np.minimum(middle[:, 0] - left, right - middle[:, 0]) / (right - left),
        np.minimum(middle[:, 1] - bottom, top - middle[:, 1]) / (top - bottom),
    )
    out[np.unique(linework.entity[long & (aside < _BORDER)])] = True
    return out


def _shapes(linework: Linework, kept: NDArray[np.bool_]) -> list[str]:
    """Return for each entity the layer that its shape or pen tells, or nothing."""
    out = np.full(len(linework.kind), "", dtype="<U12")
    lines = kept & ~linework.filled & ~np.isnan(linework.width)
    if lines.any():
        lightest = float(np.quantile(linework.width[lines], 0.02))
        out[linework.width < 0.8 * lightest] = "light-pen"
    out[linework.filled] = "hatch"
    out[_swings(linework)] = "door"
    out[frames(linework) & ~kept] = "frame"
    return [str(name) for name in out]


def _swings(linework: Linework) -> NDArray[np.bool_]:
    """Return which entities are chords of a quarter circle that the page counts among its arcs."""
    out = np.zeros(len(linework.kind), dtype=np.bool_)
    if linework.arcs is None or not len(linework.arcs):
        return out
    sweep = np.abs(linework.arcs[:, 4])
    arcs = linework.arcs[(sweep >= _QUARTER[0]) & (sweep <= _QUARTER[1])]
    starts = arcs[:, :2] + arcs[:, 2:3] * np.column_stack([np.cos(arcs[:, 3]), np.sin(arcs[:, 3])])
    first = (
        np.concatenate([[True], np.diff(linework.entity) != 0]) if len(linework.entity) else np.zeros(0, bool)
    )
    begins = {(round(float(x), 2), round(float(y), 2)) for x, y in starts}
    for segment in np.flatnonzero(first):
        e = int(linework.entity[segment])
        x, y = linework.ends[segment, 0]
        if (
            linework.kind[e] in {"arc", "polyline", "spline"}
            and (round(float(x), 2), round(float(y), 2)) in begins
        ):
            out[e] = True
    return out
