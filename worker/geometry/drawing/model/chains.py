"""Segments that share vertices, joined to the longest lines they make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SHARPEST = np.cos(np.deg2rad(150.0))


def chain_lines(vertices: NDArray[np.float64], edges: NDArray[np.int64]) -> list[NDArray[np.float64]]:
    """Return edges as polylines that run on through every vertex where exactly two of them meet.

    Parameters
    ----------
    vertices : ndarray of shape (V, 2), float64
        Positions.
    edges : ndarray of shape (E, 2), int64
        Pairs of vertices; repeated and empty ones count once and not at all.

    Returns
    -------
    list of ndarrays of shape (K, 2), float64
        A closed line ends where it began. A line does not turn back on itself by more than 150 degrees.
    """
    kept = np.unique(np.sort(edges, axis=1), axis=0)
    kept = kept[np.hypot(*(vertices[kept[:, 1]] - vertices[kept[:, 0]]).T) > 0.0]
    at: dict[int, list[int]] = {}
    for number, (a, b) in enumerate(kept.tolist()):
        at.setdefault(a, []).append(number)
        at.setdefault(b, []).append(number)
    done = np.zeros(len(kept), dtype=bool)
    lines = []
    ends_first = sorted(range(len(kept)), key=lambda e: all(len(at[int(v)]) == 2 for v in kept[e]))
    for first in ends_first:
        if done[first]:
            continue
        a, b = (int(v) for v in kept[first])
        if len(at[a]) == 2 and len(at[b]) != 2:
            a, b = b, a
        done[first] = True
        path = [a, b]
        while (following := _next(path, kept, at, done, vertices)) is not None:
            number, vertex = following
            done[number] = True
            path.append(vertex)
        lines.append(vertices[path])
    return lines


def _next(
    path: list[int],
    edges: NDArray[np.int64],
    at: dict[int, list[int]],
    done: NDArray[np.bool_],
    vertices: NDArray[np.float64],
) -> tuple[int, int] | None:
    """Return the edge that goes on from a path's end, and the vertex it leads to."""
    here = path[-1]
    if len(at[here]) != 2:
        return None
    for number in at[here]:
        if done[number]:
            continue
        vertex = int(edges[number].sum()) - here
        before, after = vertices[here] - vertices[path[-2]], vertices[vertex] - vertices[here]
        size = float(np.hypot(*before) * np.hypot(*after))
        return (number, vertex) if float(before @ after) > _SHARPEST * size else None
    return None
