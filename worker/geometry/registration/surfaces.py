"""Surfaces sampled as points with normals, searched so that a wall's two faces are told apart."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

_SIDE_WEIGHT = 0.5
_NEIGHBOURS = 12
_CORES = -1
"""All of them; each point is searched for by itself, so the answer is the same with any number."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Hold M points on surfaces with the direction in which each looks.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        In frame `map` [m].
    normals : ndarray of shape (M, 3), float64
        Unit normals; when `sided`, they point away from the solid.
    sided : bool
        Whether the sign of a normal means anything.
    coarse : bool
        Whether the points are so far apart that a scan's own normals are better than these.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    sided: bool
    coarse: bool = False

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def tree(self) -> KDTree:
        """Return a tree over the points."""
        return KDTree(self.points)

    @cached_property
    def sided_tree(self) -> KDTree:
        """Return a tree over points and normals: an opposite normal counts as 1 m of distance."""
        return KDTree(np.hstack([self.points, _SIDE_WEIGHT * self.normals]))

    def match(
        self, points: NDArray[np.float64], normals: NDArray[np.float64] | None, *, reach: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return each placed point's distance to the surface near it, its normal, and whether there is one.

        Parameters
        ----------
        points : ndarray of shape (N, 3), float64
            In frame `map` [m].
        normals : ndarray of shape (N, 3) or None
            The scan's own normals towards the tablet, in frame `map`; zero where unknown.
        reach : float
            The sample of the surface may be this far away [m].

        Returns
        -------
        tuple
            Signed distance to the plane of the matched sample (N,) [m], its normal (N, 3), found (N,).
        """
        if self.sided and normals is not None:
            known = np.linalg.norm(normals, axis=1) > 0.5
            query = np.hstack([points, _SIDE_WEIGHT * normals])
            limit = np.hypot(reach, _SIDE_WEIGHT)
            _, index = self.sided_tree.query(query, distance_upper_bound=limit, workers=_CORES)
        else:
            known = np.zeros(len(points), dtype=bool)
            _, index = self.tree.query(points, distance_upper_bound=reach, workers=_CORES)
        found = index < len(self.points)
        nearest = np.where(found, index, 0)
        between = points - self.points[nearest]
        found &= np.sum(between**2, axis=1) <= reach**2
        matched = self.normals[nearest]
        if self.sided and normals is not None:
            found &= ~known | (np.sum(matched * normals, axis=1) > 0.3)
        if self.coarse and normals is not None:
            matched = np.where(known[:, None], normals, matched)
        return np.sum(between * matched, axis=1), matched, found


def estimate_normals(
    points: NDArray[np.float64], *, towards: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return a unit normal for each point from its 12 nearest neighbours, and whether they are flat.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        A thinned cloud [m].
    towards : ndarray of shape (3,), optional
        Normals are turned to look towards this place [m].

    Returns
    -------
    tuple
        Normals (N, 3), flat (N,): the neighbours' least extent is under a third of the middle one.
    """
    tree = KDTree(points)
    count = min(_NEIGHBOURS, len(points))
    _, index = tree.query(points, k=count, workers=_CORES)
    around = points[np.asarray(index).reshape(len(points), count)]
    centred = around - around.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))
    normals = np.ascontiguousarray(vectors[:, :, 0])
    if towards is not None:
        away = np.sum((towards - points) * normals, axis=1) < 0.0
        normals[away] *= -1.0
    flat = values[:, 0] < values[:, 1] / 9.0
    return normals, flat
