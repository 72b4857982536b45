"""What a scan tells of things that were mapped before: still there, looked through, or not to be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter
from scipy.spatial import cKDTree

_BIN_RAD = np.radians(1.0)
_BEHIND_M = 0.3
_SAME_M = 0.15
_MOST_POINTS = 20_000
_FEWEST = 50
_GONE_OF_SEEN, _GONE_OF_ALL = 0.8, 0.3


@dataclass(frozen=True)
class FreeSpace:
    """Hold how many points of a mapped thing a scan bears out, and how many it looked through.

    Parameters
    ----------
    points : int
        How many were asked about.
    still_seen : int
        The scan has a point within 15 cm.
    looked_through : int
        In its direction and those around it, everything that the scan saw lies at least 30 cm farther.
    """

    points: int
    still_seen: int
    looked_through: int

    @property
    def is_gone(self) -> bool:
        """Return whether the thing has gone: of what can be told, 80 % is looked through, and 30 % of all."""
        told = self.still_seen + self.looked_through
        enough = self.looked_through >= max(_FEWEST, _GONE_OF_ALL * self.points)
        return enough and self.looked_through >= _GONE_OF_SEEN * told


def free_space(
    thing: NDArray[np.float64], scan: NDArray[np.float64], *, eye: NDArray[np.float64]
) -> FreeSpace:
    """Return what a scan tells of a thing that was mapped before.

    The nearest range in each direction decides, over a cone of three by three degrees: what is seen past the
    edge of something says nothing. A scan taken on a walk is looked at from one place only; what it saw
    from others can only make it say less.

    Parameters
    ----------
    thing : ndarray of shape (N, 3), float64
        The mapped points, in frame `map` [m].
    scan : ndarray of shape (M, 3), float64
        The placed scan, in frame `map` [m].
    eye : ndarray of shape (3,), float64
        From where the scan was taken, in frame `map` [m].
    """
    if not len(thing) or not len(scan):
        return FreeSpace(len(thing), 0, 0)
    asked = thing[:: max(1, len(thing) // _MOST_POINTS)]
    seen = np.asarray(cKDTree(scan).query(asked, distance_upper_bound=_SAME_M)[0]) < _SAME_M
    nearest = _nearest_ranges(scan - eye)
    row, column, distance = _direction(asked - eye)
    past = nearest[row, column]
    through = np.isfinite(past) & (past > distance + _BEHIND_M) & ~seen
    return FreeSpace(len(asked), int(seen.sum()), int(through.sum()))


def _nearest_ranges(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the nearest range [m] around each direction; infinite where nothing was seen."""
    rows, columns = int(np.ceil(np.pi / _BIN_RAD)) + 1, int(np.ceil(2 * np.pi / _BIN_RAD))
    ranges = np.full((rows, columns), np.inf)
    row, column, distance = _direction(rays)
    np.minimum.at(ranges, (row, column), distance)
    around: NDArray[np.float64] = minimum_filter(ranges, size=3, mode=("nearest", "wrap"))
    return np.where(np.isfinite(ranges), around, np.inf)


def _direction(
    rays: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return each ray's elevation row, azimuth column and length [m]."""
    distance = np.linalg.norm(rays, axis=1)
    safe = np.maximum(distance, 1e-9)
    elevation = np.arccos(np.clip(rays[:, 2] / safe, -1.0, 1.0))
    azimuth = np.arctan2(rays[:, 1], rays[:, 0]) % (2 * np.pi)
    columns = int(np.ceil(2 * np.pi / _BIN_RAD))
    row = (elevation / _BIN_RAD).astype(np.intp)
    return row, np.minimum((azimuth / _BIN_RAD).astype(np.intp), columns - 1), distance
