"""The covariance of a cell's points: exact, as a robot's NDT makes it, and inverted for the map."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from worker.geometry.registration.symmetric import eigen

_LEAST_EIGENVALUE_SHARE = 0.01
_FLATTEST = 1e-12

CellCovariance = Literal["exact", "pcl-1.11", "autoware"]
"""What a robot's NDT makes of a cell's points: the same cloud is another map to another localizer."""


def as_run(
    exact: NDArray[np.float64], counts: NDArray[np.int64], covariance: CellCovariance
) -> NDArray[np.float64]:
    """Return the covariances of cells as a robot's NDT has them.

    Parameters
    ----------
    exact : ndarray of shape (C, 6), float64
        xx, xy, xz, yy, yz, zz over n - 1 of each cell [m^2].
    counts : ndarray of shape (C,), int64
        Points of each cell.
    covariance : {"exact", "pcl-1.11", "autoware"}
        Whose NDT: `build_ndt_map` says what each adds.
    """
    n, identity = counts[:, None].astype(np.float64), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    if covariance == "pcl-1.11":
        old: NDArray[np.float64] = ((n - 1.0) * exact + identity) / n * (n - 1.0) / n
        return old
    if covariance == "autoware":
        return exact + identity / (n - 1.0)
    return exact


@njit(cache=True, parallel=True)
def inverted(
    covariances: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return the inverses of covariances made thick enough, normals, and which are no mere lines or points.

    Parameters
    ----------
    covariances : ndarray of shape (C, 6), float64
        xx, xy, xz, yy, yz, zz of each cell [m^2].

    Returns
    -------
    inverses : ndarray of shape (C, 6), float64
        In the same order [1/m^2]; a cell flatter than 1:100 is thickened to that (Magnusson 2009, 6.11).
    normals : ndarray of shape (C, 3), float64
        Direction in which each is thinnest.
    solid : ndarray of shape (C,), bool
        Whether it has an extent in two directions.
    """
    count = len(covariances)
    inverses, normals = np.zeros((count, 6)), np.zeros((count, 3))
    solid = np.zeros(count, dtype=np.bool_)
    for c in prange(count):
        w, v = np.zeros(3), np.zeros((3, 3))
        eigen(covariances[c], w, v)
        solid[c] = w[2] > _FLATTEST
        least = max(_LEAST_EIGENVALUE_SHARE * w[2], 1e-300)
        a, b, d = 1.0 / max(w[0], least), 1.0 / max(w[1], least), 1.0 / max(w[2], least)
        out = inverses[c]
        out[0] = a * v[0, 0] * v[0, 0] + b * v[0, 1] * v[0, 1] + d * v[0, 2] * v[0, 2]
        out[1] = a * v[0, 0] * v[1, 0] + b * v[0, 1] * v[1, 1] + d * v[0, 2] * v[1, 2]
        out[2] = a * v[0, 0] * v[2, 0] + b * v[0, 1] * v[2, 1] + d * v[0, 2] * v[2, 2]
        out[3] = a * v[1, 0] * v[1, 0] + b * v[1, 1] * v[1, 1] + d * v[1, 2] * v[1, 2]
        out[4] = a * v[1, 0] * v[2, 0] + b * v[1, 1] * v[2, 1] + d * v[1, 2] * v[2, 2]
        out[5] = a * v[2, 0] * v[2, 0] + b * v[2, 1] * v[2, 1] + d * v[2, 2] * v[2, 2]
        normals[c, 0], normals[c, 1], normals[c, 2] = v[0, 0], v[1, 0], v[2, 0]
    return inverses, normals, solid
