"""The walls of a bare cloud, seen from above: where points stand above each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

_FINEST = 0.1
_SPACING_SAMPLE = 2_000
_TALL = 1.0
_LEAST_LEVELS = 3
_NEIGHBOURS = 6
_ALONG = 0.1


@dataclass(frozen=True, eq=False)
class CloudOutline:
    """Hold the upright parts of a cloud; both sides of each are taken for faces, since it has no inside.

    Parameters
    ----------
    samples : tuple of ndarrays of shape (M, 2), float64
        Places [m], and the unit directions in which they look.
    """

    samples: tuple[NDArray[np.float64], NDArray[np.float64]]

    @classmethod
    def of(cls, points: NDArray[np.float64]) -> CloudOutline:
        """Return the outline of a cloud, (M, 3) in frame `map` [m].

        Notes
        -----
        Columns as wide as the cloud's spacing that reach up at least a metre; the direction from the nearest
        six columns; places are filled in along it, so that a coarse cloud gives lines as well.
        """
        spacing = _spacing(points)
        cell = max(_FINEST, 1.1 * spacing)
        _, member = np.unique(np.floor(points[:, :2] / cell).astype(np.int64), axis=0, return_inverse=True)
        member = member.ravel()
        count = np.bincount(member)
        low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
        np.minimum.at(low, member, points[:, 2])
        np.maximum.at(high, member, points[:, 2])
        tall = (high - low >= _TALL) & (count >= _LEAST_LEVELS)
        feet = np.column_stack([np.bincount(member, weights=points[:, k]) for k in (0, 1)])[tall]
        feet /= count[tall, None]
        if len(feet) < _NEIGHBOURS:
            return cls((np.zeros((0, 2)), np.zeros((0, 2))))
        _, near = KDTree(feet).query(feet, k=_NEIGHBOURS)
        off = feet[near] - feet[near].mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", off, off))
        outward, along = vectors[:, :, 0], vectors[:, :, 1]
        steps = np.arange(-cell / 2, cell / 2 + 1e-9, _ALONG) if cell > 2 * _ALONG else np.zeros(1)
        every = (feet[:, None] + steps[None, :, None] * along[:, None]).reshape(-1, 2)
        out = np.repeat(outward, len(steps), axis=0)
        return cls((np.vstack([every, every]), np.vstack([out, -out])))

    def hidden_from(
        self, eye: NDArray[np.float64], points: NDArray[np.float64], *, clearance: float = 0.25
    ) -> NDArray[np.bool_]:
        """Return that no point is hidden: a cloud has holes where nobody looked.

        Parameters
        ----------
        eye : ndarray of shape (2,), float64
        points : ndarray of shape (N, 2), float64
        clearance : float
            As `Faces.hidden_from` takes them.
        """
        del eye, clearance
        return np.zeros(len(points), dtype=bool)


def _spacing(points: NDArray[np.float64]) -> float:
    """Return the median distance of some points to their nearest neighbour [m]."""
    some = points[:: 1 + len(points) // _SPACING_SAMPLE]
    distance, _ = KDTree(points).query(some, k=2)
    return float(np.median(np.asarray(distance)[:, 1]))
