"""What a scan tells of things that were mapped before: still there, looked through, or not to be seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, minimum_filter
from scipy.spatial import ConvexHull, QhullError, cKDTree

from service.domain.region import Region

_BIN_RAD = np.radians(1.0)
_ROWS, _COLUMNS = 181, 360
_BEHIND_M, _SAME_M = 0.3, 0.15
_CELL_M, _MOST_CELLS = 0.25, 2e7
_FLOOR_M = 0.15
_FEWEST = 100
_GONE_OF_SEEN, _GONE_OF_ALL = 0.8, 0.1
_BEYOND_M = 0.1


@dataclass(frozen=True, eq=False)
class MappedThing:
    """Hold one thing that a layer shows: points that touch one another, and where it stands.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        In frame `map` [m].
    region : Region
        Around it, 10 cm wider; down to the floor where it stands on it.
    """

    points: NDArray[np.float64]
    region: Region


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
        """Return whether the thing has gone: of what can be told, 80 % is looked through, and 10 % of all."""
        told = self.still_seen + self.looked_through
        enough = self.looked_through >= max(_FEWEST, _GONE_OF_ALL * self.points)
        return enough and self.looked_through >= _GONE_OF_SEEN * told


@dataclass(frozen=True, eq=False)
class Sight:
    """Hold what a placed scan saw, and from where.

    The nearest range in each direction decides, over a cone of three by three degrees: what is seen past the
    edge of something says nothing. A scan taken on a walk is looked at from one place only; what it saw
    from others can only make it say less.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        The scan, in frame `map` [m].
    eye : ndarray of shape (3,), float64
        From where it was taken, in frame `map` [m].
    """

    points: NDArray[np.float64]
    eye: NDArray[np.float64]

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def _nearest(self) -> NDArray[np.float64]:
        """Return the nearest range [m] around each direction; infinite where nothing was seen."""
        ranges = np.full((_ROWS, _COLUMNS), np.inf)
        row, column, distance = _direction(self.points - self.eye)
        np.minimum.at(ranges, (row, column), distance)
        around: NDArray[np.float64] = minimum_filter(ranges, size=3, mode=("nearest", "wrap"))
        return np.where(np.isfinite(ranges), around, np.inf)

    def of(self, points: NDArray[np.float64]) -> FreeSpace:
        """Return what the scan tells of (N, 3) points of a mapped thing, in frame `map` [m]."""
        near = np.asarray(self._tree.query(points, distance_upper_bound=_SAME_M)[0]) < _SAME_M
        row, column, distance = _direction(points - self.eye)
        past = self._nearest[row, column]
        through = np.isfinite(past) & (past > distance + _BEHIND_M) & ~near
        return FreeSpace(len(points), int(near.sum()), int(through.sum()))


def things_of(points: NDArray[np.float64], *, top: float) -> Iterator[MappedThing]:
    """Give the things that a layer's points show: what touches at 25 cm, between floor and ceiling.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The layer, in frame `map` [m].
    top : float
        The walls' height [m].
    """
    upright = points[(points[:, 2] > _FLOOR_M) & (points[:, 2] < top - _FLOOR_M)]
    if not len(upright):
        return
    cell = np.floor((upright - upright.min(axis=0)) / _CELL_M).astype(np.intp)
    shape = tuple(cell.max(axis=0) + 1)
    if np.prod(np.array(shape, dtype=np.float64)) > _MOST_CELLS:
        return
    filled = np.zeros(shape, dtype=np.bool_)
    filled[tuple(cell.T)] = True
    groups, count = label(filled, structure=np.ones((3, 3, 3)))
    mine = groups[tuple(cell.T)]
    for number in range(1, count + 1):
        thing = upright[mine == number]
        if len(thing) >= _FEWEST and (region := _around(thing)) is not None:
            yield MappedThing(thing, region)


def _around(thing: NDArray[np.float64]) -> Region | None:
    """Return the region of a thing: its hull from above, 10 cm wider; None if it has no width at all."""
    try:
        hull = ConvexHull(thing[:, :2])
    except QhullError:
        return None
    corners = thing[hull.vertices, :2]
    outward = corners - corners.mean(axis=0)
    wider = corners + outward / np.linalg.norm(outward, axis=1)[:, None] * _BEYOND_M
    low, high = float(thing[:, 2].min()), float(thing[:, 2].max())
    within = tuple((round(float(x), 3), round(float(y), 3)) for x, y in wider)
    stands = low < 2 * _FLOOR_M
    return Region(within, None if stands else round(low - _BEYOND_M, 3), round(high + _BEYOND_M, 3))


def _direction(
    rays: NDArray[np.float64],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return each ray's elevation row, azimuth column and length [m]."""
    distance = np.linalg.norm(rays, axis=1)
    elevation = np.arccos(np.clip(rays[:, 2] / np.maximum(distance, 1e-9), -1.0, 1.0))
    azimuth = np.arctan2(rays[:, 1], rays[:, 0]) % (2 * np.pi)
    column = np.minimum((azimuth / _BIN_RAD).astype(np.intp), _COLUMNS - 1)
    return (elevation / _BIN_RAD).astype(np.intp), column, distance
