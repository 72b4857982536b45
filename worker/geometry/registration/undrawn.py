"""What of a scan is not on the map: an object, or a wall that the map lacks or has elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration.measure import Fit

_HEADINGS = 72
_ALIGNED = np.cos(np.deg2rad(14.0))
_WIDTH = 0.1
_TOP = 0.4


def undrawn_wall_share(fit: Fit, normals: NDArray[np.float64]) -> float:
    """Return the largest share of the structure that stands on one upright plane without being on the map.

    A wall of a room is a tenth of what is scanned of it or more, on one plane. Shelves with goods show many.

    Parameters
    ----------
    fit : Fit
        At the pose.
    normals : ndarray of shape (N, 3), float64
        The scan's own, in frame `map`; zero where it is not flat.

    Notes
    -----
    The fullest of slices 20 cm wide, in 72 headings.
    """
    structure = int(np.count_nonzero(fit.structure))
    loose = fit.structure & ~fit.inlier
    if not loose.any():
        return 0.0
    p, n = fit.placed[loose, :2], normals[loose, :2]
    p, n = p - p.mean(axis=0), n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    most = 0
    for heading in np.arange(_HEADINGS) * (2.0 * np.pi / _HEADINGS):
        along = np.array([np.cos(heading), np.sin(heading)])
        offset = np.floor(p[n @ along > _ALIGNED] @ along / _WIDTH).astype(np.int64)
        if len(offset) > most:
            counts = np.bincount(offset - offset.min())
            most = max(most, int(np.convolve(counts, [1, 1]).max()))
    return most / structure


def explained_share_at_top(fit: Fit) -> float:
    """Return the share of the upright points in the uppermost 40 cm that are on the map; 0 of none.

    Parameters
    ----------
    fit : Fit
        At the pose.
    """
    if not fit.upright.any():
        return 0.0
    top = np.percentile(fit.placed[fit.upright, 2], 99.0) - _TOP
    return float(np.mean(fit.inlier[fit.upright & (fit.placed[:, 2] > top)]))
