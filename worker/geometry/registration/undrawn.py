"""What of a scan is not on the map: an object, or a wall that the map lacks or has elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration.measure import Fit

_HEADINGS = 72
_ALIGNED = np.cos(np.deg2rad(14.0))
_WIDTH = 0.1
_TOP, _BREAST, _CELL = 0.4, 1.0, 0.2


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
    return float(np.mean(fit.inlier[_at_top(fit)]))


def walled_share(fit: Fit) -> float:
    """Return the share of the upright points in the uppermost 40 cm that stand on a wall that the map lacks.

    They are off the map, and so is what is upright beneath them, down to breast height: a door that is walled
    up. The wall above an open door has nothing beneath it.

    Parameters
    ----------
    fit : Fit
        At the pose.
    """
    top = _at_top(fit)
    if not top.any():
        return 0.0
    low = fit.placed[top, 2].min() - _TOP
    beneath = fit.upright & ~fit.inlier & (fit.placed[:, 2] > _BREAST) & (fit.placed[:, 2] < low)
    cells = [
        np.floor(fit.placed[among, :2] / _CELL).astype(np.int64) for among in (top & ~fit.inlier, beneath)
    ]
    above, held = ((cell[:, 0] << 32) + cell[:, 1] for cell in cells)
    around = [(i << 32) + j for i in (-1, 0, 1) for j in (-1, 0, 1)]
    walled = np.any([np.isin(above + step, held) for step in around], axis=0)
    return float(np.count_nonzero(walled) / np.count_nonzero(top))


def _at_top(fit: Fit) -> NDArray[np.bool_]:
    """Return which points are upright and in the uppermost 40 cm."""
    if not fit.upright.any():
        return fit.upright
    top = np.percentile(fit.placed[fit.upright, 2], 99.0) - _TOP
    return np.asarray(fit.upright & (fit.placed[:, 2] > top), dtype=np.bool_)
