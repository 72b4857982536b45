"""Points of a scan that stand alone: what is left of reflections, of people walking by, of the sky."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

_NEIGHBOURS = 6
_SIGMAS = 6.0
_NEAR = 0.15
_SPREAD = 0.15
_MOST_MEASURED = 1_000_000


def find_outliers(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points stand alone.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The scan [m].

    Returns
    -------
    ndarray of shape (N,), bool
        True for an outlier; at most a twentieth of the points, else none: then the scan is thin, not dirty.

    Notes
    -----
    The distance to the sixth neighbour, as a logarithm, is compared with its median; an outlier is more than
    six robust standard deviations (MAD) above it, and farther than 15 cm from that neighbour. Of more than a
    million points every k-th is a possible neighbour, all are measured. O(N log N).
    """
    if len(points) <= 4 * _NEIGHBOURS:
        return np.zeros(len(points), dtype=np.bool_)
    step = max(1, -(-len(points) // _MOST_MEASURED))
    tree = cKDTree(points[::step])
    apart = np.zeros(len(points))
    for start in range(0, len(points), _MOST_MEASURED):
        some = slice(start, start + _MOST_MEASURED)
        distances, _ = tree.query(points[some], k=[_NEIGHBOURS + 1])
        apart[some] = np.ravel(distances)
    logs = np.log(np.maximum(apart, 1e-6))
    middle = float(np.median(logs))
    spread = max(1.4826 * float(np.median(np.abs(logs - middle))), _SPREAD)
    alone = (logs > middle + _SIGMAS * spread) & (apart > _NEAR)
    return alone if alone.sum() <= 0.05 * len(points) else np.zeros(len(points), dtype=np.bool_)
