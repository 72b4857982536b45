"""The surfaces of a bare cloud that a tablet can see: which side they look to is not in the points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worker.geometry.registration.cell_moments import cell_moments
from worker.geometry.registration.neighbours import NeighbourGrid
from worker.geometry.registration.surfaces import NEIGHBOURS, Surfaces

_STEP = 0.05
_THINNEST, _THICKEST = 0.08, 0.5
_ASIDE = 0.75
_MOST_SPACED = 2_000
_TILE, _BEYOND = 8.0, 5
COARSE = 0.2
"""Points farther apart than this [m] tell little of a surface's direction and nothing of the tilt."""


def point_spacing(points: NDArray[np.float64]) -> float:
    """Return the usual distance [m] of a cloud's points (N, 3) from their nearest neighbours."""
    if len(points) < 2:
        return 0.0
    some = points[:: 1 + len(points) // _MOST_SPACED]
    nearest, _ = KDTree(points, balanced_tree=False, compact_nodes=False).query(some, k=[2])
    return float(np.median(nearest))


@dataclass(frozen=True, eq=False)
class TwoSided:
    """Hold P points of a cloud with what they are to who looks at either side of them.

    Parameters
    ----------
    points : ndarray of shape (P, 3), float64
        In frame `map` [m].
    normals : ndarray of shape (2, P, 3), float64
        Unit normals as seen from the one side and from the other, each towards its own.
    behind : ndarray of shape (2, P), bool
        Whether something else stands right in front of the point on that side.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    behind: NDArray[np.bool_]

    def seen_from(self, eye: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the points (K, 3) that can be seen from a place (3,) [m], and their normals towards it."""
        side = (np.sum((eye - self.points) * self.normals[0], axis=1) < 0.0).astype(np.intp)
        front = np.flatnonzero(~self.behind[side, np.arange(len(side))])
        points, normals = self.points[front], self.normals[side[front], front]
        away = np.sum((eye - points) * normals, axis=1) < 0.0
        normals[away] *= -1.0
        return points, normals


@dataclass(frozen=True, eq=False)
class CloudSurfaces:
    """Hold a cloud thinned to 5 cm, and of its tiles of 8 m those looked at so far with their two sides.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        The thinned cloud [m].
    spacing : float
        Usual distance between neighbours [m].

    Notes
    -----
    A wall is two layers of points. From inside a room the farther one cannot be seen, and a scan that is
    pulled to it comes to lie a wall's thickness off (the paper's failure in -Y, section 4.4). A point is
    behind if 8 to 50 cm ahead along its normal there is another, aside by no more than three quarters of the
    usual distance between points. Normals are found anew without those. O(N) for the points of the tiles.
    """

    points: NDArray[np.float64]
    spacing: float
    _tiles: dict[tuple[int, int], TwoSided] = field(default_factory=dict)

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> CloudSurfaces:
        """Return the surfaces of a cloud (N, 3) in frame `map` [m]."""
        thinned = cell_moments(points, _STEP).means
        return cls(thinned, point_spacing(thinned))

    def around(self, centre: NDArray[np.float64], radius: float, *, eye: NDArray[np.float64]) -> Surfaces:
        """Return the surfaces within `radius` [m] of `centre` (3,), seen from above, that look towards `eye`.

        Parameters
        ----------
        centre : ndarray of shape (3,), float64
            [m].
        radius : float
            [m].
        eye : ndarray of shape (3,), float64
            Where the tablet was, give or take some decimetres [m].

        Returns
        -------
        Surfaces
            Sided: normals look towards `eye`.
        """
        low = np.floor((centre[:2] - radius) / _TILE).astype(int)
        high = np.floor((centre[:2] + radius) / _TILE).astype(int)
        points, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
        for x in range(low[0], high[0] + 1):
            for y in range(low[1], high[1] + 1):
                seen, looks = self._tile(x, y).seen_from(eye)
                near = np.sum((seen[:, :2] - centre[:2]) ** 2, axis=1) < radius**2
                points.append(seen[near])
                normals.append(looks[near])
        return Surfaces(np.vstack(points), np.vstack(normals), sided=True, coarse=self.spacing > COARSE)

    def _tile(self, x: int, y: int) -> TwoSided:
        if (x, y) not in self._tiles:
            low = np.array([x, y]) * _TILE
            beyond = max(_THICKEST, _BEYOND * self.spacing)
            off = self.points[:, :2] - low
            local = self.points[((off >= -beyond) & (off < _TILE + beyond)).all(axis=1)]
            inside = ((local[:, :2] >= low) & (local[:, :2] < low + _TILE)).all(axis=1)
            both = two_sided(local, self.spacing)
            self._tiles[x, y] = TwoSided(local[inside], both.normals[:, inside], both.behind[:, inside])
        return self._tiles[x, y]


def two_sided(points: NDArray[np.float64], spacing: float) -> TwoSided:
    """Return a thinned cloud (P, 3) with its two sides, its points usually `spacing` apart [m]."""
    if len(points) < 3:
        return TwoSided(points, np.zeros((2, *points.shape)), np.zeros((2, len(points)), dtype=np.bool_))
    grid = NeighbourGrid.with_cells_of_some(points)
    first = np.ascontiguousarray(grid.spreads(neighbours=NEIGHBOURS)[1][:, :, 0])
    behind = np.zeros((2, len(points)), dtype=np.bool_)
    aside = max(_ASIDE * spacing, _STEP)
    for side, sign in enumerate((1.0, -1.0)):
        for ahead in np.arange(_THINNEST, _THICKEST, min(aside, 2 * _STEP)) + aside:
            left = np.flatnonzero(~behind[side])
            gap, _ = grid.nearest(points[left] + sign * ahead * first[left], reach=aside)
            behind[side, left[np.isfinite(gap)]] = True
    sided = NeighbourGrid.of(points, first, cell=grid.cell)
    normals = []
    for sign in (1.0, -1.0):
        vectors = sided.spreads(neighbours=NEIGHBOURS, left_out=behind.T, looks=sign * first)[1]
        found = vectors[:, :, 0]
        away = sign * np.sum(found * first, axis=1) < 0.0
        normals.append(np.where(away[:, None], -found, found))
    return TwoSided(points, np.array(normals), behind)
