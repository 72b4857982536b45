"""Curves of vector pages: flattened to points, and recognised as circular arcs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
Arc = tuple[float, float, float, float, float]
"""Centre x, y, radius, start and sweep [rad]; the sweep is positive counter-clockwise."""

_MOST_PIECES = 64
_ROUND = 0.004
_LEAST_CHORDS = 4
_LARGEST_TURN = math.radians(35.0)


def flatten_cubic(curve: Sequence[Point], *, tolerance: float) -> list[Point]:
    """Return the points of a cubic Bezier curve after its first, so dense that no chord is off by more.

    Parameters
    ----------
    curve : sequence of four points
        Start, two controls and end.
    tolerance : float
        Largest distance between the curve and its chords, in the curve's unit.

    Returns
    -------
    list of tuple of float
        At most 64 points, the last of which is the curve's end.

    Notes
    -----
    A chord over a parameter step h is off by at most h^2 / 8 times the second derivative, which is
    largest at a control: 6 |p0 - 2 p1 + p2| or 6 |p1 - 2 p2 + p3|.
    """
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = curve
    bend = max(math.hypot(ax - 2 * bx + cx, ay - 2 * by + cy), math.hypot(bx - 2 * cx + dx, by - 2 * cy + dy))
    if not math.isfinite(bend):
        return [(dx, dy)]
    pieces = min(max(1, math.ceil(math.sqrt(0.75 * bend / tolerance))), _MOST_PIECES)
    points = []
    for i in range(1, pieces):
        t = i / pieces
        s = 1.0 - t
        a, b, c, d = s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t
        points.append((a * ax + b * bx + c * cx + d * dx, a * ay + b * by + c * cy + d * dy))
    return [*points, (dx, dy)]


def arc_of(points: NDArray[np.float64]) -> Arc | None:
    """Return the circular arc that the (K, 2) points lie on in order, or None where they lie on none.

    The points have to be at least five, to turn one way by at most 35 degrees each, and to keep within
    0.4 % of the radius; two straight lines and a polygon of few sides are no arc.
    """
    if len(points) < _LEAST_CHORDS + 1:
        return None
    step = np.diff(points, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    if not (length > 0).all() or not np.isfinite(length).all():
        return None
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    turn = np.diff(heading)
    one_way = (turn > 0).all() or (turn < 0).all()
    if not one_way or np.abs(turn).max() > _LARGEST_TURN:
        return None
    centre, radius = _circle(points)
    if not math.isfinite(radius) or radius <= 0:
        return None
    away = np.hypot(points[:, 0] - centre[0], points[:, 1] - centre[1])
    if np.abs(away - radius).max() > max(_ROUND * radius, 1e-9):
        return None
    angle = np.unwrap(np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0]))
    return (centre[0], centre[1], radius, float(angle[0]), float(angle[-1] - angle[0]))


def _circle(points: NDArray[np.float64]) -> tuple[Point, float]:
    """Return centre and radius of the least-squares circle (Kasa), with numbers near zero."""
    middle = points.mean(axis=0)
    xy = points - middle
    A = np.column_stack([2 * xy, np.ones(len(xy))])
    solution, *_ = np.linalg.lstsq(A, (xy**2).sum(axis=1), rcond=None)
    squared = solution[2] + solution[0] ** 2 + solution[1] ** 2
    radius = math.sqrt(squared) if squared > 0 else math.nan
    return (float(solution[0] + middle[0]), float(solution[1] + middle[1])), radius
