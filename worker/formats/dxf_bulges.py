"""Polylines with bulges as chords and arcs, all their sides at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FULL_CIRCLE = 64
"""Chords of a whole circle."""

LEAST_CHORDS = 4
"""Chords of any arc at least."""


@np.errstate(invalid="ignore", over="ignore")  # such places are told later
def bulged_path(vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the path of a polyline whose sides may be arcs, and these arcs.

    Parameters
    ----------
    vertices : ndarray of shape (N, 3), float64
        x, y and the bulge of the side that begins there: the tangent of a quarter of its sweep, positive
        counter-clockwise; N >= 2, and the last bulge counts not.

    Returns
    -------
    path : ndarray of shape (K, 2), float64
        Vertices and the points between the chords of arcs, without repeated vertices.
    arcs : ndarray of shape (A, 5), float64
        Centre x, y, radius, start and sweep [rad].

    Raises
    ------
    ValueError
        If a bulge is not a finite number.
    """
    begin, end, bulge = vertices[:-1, :2], vertices[1:, :2], vertices[:-1, 2]
    if not np.isfinite(bulge).all():
        msg = "a bulge that is no finite number"
        raise ValueError(msg)
    curved = (bulge != 0) & (begin != end).any(axis=1)
    arcs = _arcs(begin[curved], end[curved], bulge[curved])
    between = np.zeros(len(begin), dtype=np.int64)
    between[curved] = np.maximum(LEAST_CHORDS, np.ceil(np.abs(arcs[:, 4]) / (2 * np.pi) * FULL_CIRCLE)) - 1
    last = np.cumsum(between + 1)
    path = np.zeros((last[-1] + 1, 2))
    path[0], path[last] = begin[0], end
    owner = np.repeat(np.arange(len(arcs)), between[curved])
    step = np.arange(len(owner)) - np.repeat(np.cumsum(between[curved]) - between[curved], between[curved])
    share = (step + 1) / (between[curved] + 1)[owner]
    x, y, radius, start, sweep = arcs[owner].T
    angle = start + sweep * share
    inside = np.ones(len(path), dtype=np.bool_)
    inside[0] = inside[last] = False
    path[inside] = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
    again = np.zeros(len(path), dtype=np.bool_)
    again[last] = (path[last] == path[last - 1]).all(axis=1)
    return path[~again], arcs


def _arcs(
    begin: NDArray[np.float64], end: NDArray[np.float64], bulge: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (A, 5) arcs over chords: the centre stands off a chord's middle by (1 - b^2) / 4b of it."""
    chord = end - begin
    off = ((1.0 - bulge**2) / (4.0 * bulge))[:, None]
    centre = (begin + end) / 2.0 + off * np.column_stack([-chord[:, 1], chord[:, 0]])
    radius = np.hypot(chord[:, 0], chord[:, 1]) * (1.0 + bulge**2) / (4.0 * np.abs(bulge))
    start = np.arctan2(begin[:, 1] - centre[:, 1], begin[:, 0] - centre[:, 0])
    return np.column_stack([centre, radius, start, 4.0 * np.arctan(bulge)])
