"""A horizontal cut through a triangle mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

_OFF = 1e-6
_WELD = 2e-5
_STEPS = 40


def cut_mesh(
    vertices: NDArray[np.float64], triangles: NDArray[np.int64], height: float
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Return the closed rings and the open lines in which a mesh meets the plane z = `height`.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float64
        Shared between the triangles that meet in them [m].
    triangles : ndarray of shape (F, 3), int64
        Outward normals by the right-hand rule: then the material lies to the left of a ring.
    height : float
        Where to cut [m]; a plane through a vertex is raised by some micrometres.

    Returns
    -------
    tuple of two lists of ndarrays of shape (K, 2), float64
        Rings without the closing point, and lines, which are open: the mesh is a surface and no solid there.
    """
    z = vertices[:, 2]
    for _ in range(_STEPS):
        if not (np.abs(z - height) < _OFF).any():
            break
        height += 2.3 * _OFF
    above = z > height
    count = above[triangles].sum(axis=1)
    crossing = triangles[(count == 1) | (count == 2)]
    if not len(crossing):
        return [], []
    starts, ends = _links(crossing, above)
    keys, index = np.unique(np.vstack([starts, ends]), axis=0, return_inverse=True)
    share = (height - z[keys[:, 0]]) / (z[keys[:, 1]] - z[keys[:, 0]])
    points = vertices[keys[:, 0], :2] + share[:, None] * (vertices[keys[:, 1], :2] - vertices[keys[:, 0], :2])
    index, points = _welded(index.reshape(-1), points)
    return _walk(index[: len(starts)], index[len(starts) :], points)


def _welded(
    index: NDArray[np.int64], points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return points that lie on each other as one: a mesh may not share its vertices everywhere."""
    pairs = cKDTree(points).query_pairs(_WELD, output_type="ndarray")
    if not len(pairs):
        return index, points
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    count, group = connected_components(links, directed=False)
    merged = np.zeros((count, 2))
    merged[group] = points
    return np.asarray(group[index], dtype=np.int64), merged


def _links(
    crossing: NDArray[np.int64], above: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for each crossing triangle the two mesh edges it is cut at, material to the left of the link."""
    up = above[crossing]
    lonely_up = up.sum(axis=1) == 1
    apex = np.where(lonely_up, up.argmax(axis=1), (~up).argmax(axis=1))
    rows = np.arange(len(crossing))
    tip, second, third = (crossing[rows, (apex + k) % 3] for k in range(3))
    one, two = np.sort(np.column_stack([tip, second]), axis=1), np.sort(np.column_stack([tip, third]), axis=1)
    # Seen from outside, counter-clockwise tip-second-third: with the tip above, the cut runs from the edge
    # tip-third to the edge tip-second when the material (behind) is to lie on its left.
    swap = ~lonely_up
    starts = np.where(swap[:, None], two, one)
    ends = np.where(swap[:, None], one, two)
    return starts, ends


def _walk(
    starts: NDArray[np.int64], ends: NDArray[np.int64], points: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
    """Join links to rings and lines; each link is walked once."""
    leaving: dict[int, list[int]] = {}
    apart = starts != ends
    starts, ends = starts[apart], ends[apart]
    for number, node in enumerate(starts.tolist()):
        leaving.setdefault(node, []).append(number)
    entered = np.bincount(ends, minlength=len(points))
    left = np.bincount(starts, minlength=len(points))
    open_first = sorted(range(len(starts)), key=lambda k: bool(entered[starts[k]] >= left[starts[k]]))
    done = np.zeros(len(starts), dtype=bool)
    rings: list[NDArray[np.float64]] = []
    lines: list[NDArray[np.float64]] = []
    for first in open_first:
        if done[first]:
            continue
        path = [int(starts[first])]
        link: int | None = first
        while link is not None:
            done[link] = True
            node = int(ends[link])
            path.append(node)
            link = None if node == path[0] else next((k for k in leaving.get(node, []) if not done[k]), None)
        line = points[path]
        if path[0] == path[-1] and len(path) > 3:
            rings.append(line[:-1])
        elif path[0] != path[-1]:
            lines.append(line)
    return rings, lines
