"""Points of a scan that stand alone: what is left of reflections, of people walking by, of the sky."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.cloud.places import distinct_places, row_keys
from worker.geometry.cloud.voxel_grid import voxel_index

_NEIGHBOURS = 6
_SIGMAS = 6.0
_NEAR = 0.15
_SPREAD = 0.15
_MOST_NEIGHBOURS = 1_000_000
_MEASURED = 250_000


def find_outliers(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points stand alone.

    Points at the very same place count as one, as a depth camera's zeros do: they are no neighbours of each
    other.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The scan [m].

    Returns
    -------
    ndarray of shape (N,), bool
        True for an outlier; at most a twentieth of the places, else none: then the scan is thin, not dirty.

    Notes
    -----
    The distance to the sixth neighbour, as a logarithm, is compared with its median; an outlier is more than
    six robust standard deviations (MAD) above it, and farther than 15 cm from that neighbour. A place with
    six others in a voxel that is no longer than that, from corner to corner, needs no measuring. Of more than
    a million places every k-th is a possible neighbour; of more than a quarter million every k-th tells the
    median. O(N log N), however many points share a place.
    """
    first, place = distinct_places(points)
    return np.asarray(_alone(points[first])[place], dtype=np.bool_)


def _alone(places: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of (M, 3) places, no two of them equal, stand alone."""
    alone = np.zeros(len(places), dtype=np.bool_)
    if len(places) <= 4 * _NEIGHBOURS:
        return alone
    step = max(1, -(-len(places) // _MOST_NEIGHBOURS))
    tree = cKDTree(places[::step])
    usual = _log_apart(tree, places[:: max(1, -(-len(places) // _MEASURED))])
    middle = float(np.median(usual))
    spread = max(1.4826 * float(np.median(np.abs(usual - middle))), _SPREAD)
    most = max(middle + _SIGMAS * spread, math.log(_NEAR))
    lonely = np.flatnonzero(~_is_crowded(places, math.exp(most)))
    alone[lonely] = _log_apart(tree, places[lonely]) > most
    return alone if alone.sum() <= 0.05 * len(places) else np.zeros(len(places), dtype=np.bool_)


def _log_apart(tree: cKDTree, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithms of the distances to the sixth neighbour [m]."""
    distances, _ = tree.query(places, k=[_NEIGHBOURS + 1])
    return np.asarray(np.log(np.maximum(np.ravel(distances), 1e-6)), dtype=np.float64)


def _is_crowded(places: NDArray[np.float64], diagonal: float) -> NDArray[np.bool_]:
    """Return which places share a voxel of a diagonal [m] with six others or more."""
    keys = row_keys(voxel_index(places, diagonal / math.sqrt(3.0)))
    _, voxel, count = np.unique(keys, return_inverse=True, return_counts=True)
    return np.asarray(count[voxel] > _NEIGHBOURS, dtype=np.bool_)
