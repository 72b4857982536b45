"""Points spread evenly over the triangles of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_PLASTIC = 1.324717957244746
_STEPS = np.array([1.0 / _PLASTIC, 1.0 / _PLASTIC**2])


@dataclass(frozen=True, eq=False)
class Mesh:
    """Hold a surface of triangles.

    Parameters
    ----------
    vertices : ndarray of shape (V, 3), float64
        Corners, in the unit and axes that the holder names.
    triangles : ndarray of shape (F, 3), int64
        Indices of corners.

    Raises
    ------
    ValueError
        If the shapes are wrong, a vertex is not finite, or an index points nowhere.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]

    def __post_init__(self) -> None:
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or not np.isfinite(self.vertices).all():
            msg = f"vertices are finite and (V, 3), not {self.vertices.shape}"
            raise ValueError(msg)
        if self.triangles.ndim != 2 or self.triangles.shape[1] != 3:
            msg = f"triangles are (F, 3), not {self.triangles.shape}"
            raise ValueError(msg)
        if self.triangles.size and not 0 <= self.triangles.min() <= self.triangles.max() < len(self.vertices):
            msg = f"a triangle points outside the {len(self.vertices)} vertices"
            raise ValueError(msg)

    def areas(self) -> NDArray[np.float64]:
        """Return the (F,) areas of the triangles [unit^2]."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def sample_mesh(mesh: Mesh, *, count: int) -> NDArray[np.float64]:
    """Return points spread over a mesh, each standing for the same area.

    Parameters
    ----------
    mesh : Mesh
        F >= 1 triangles.
    count : int
        How many points, N >= 1.

    Returns
    -------
    ndarray of shape (N, 3), float64
        In the order of the triangles; of shape (0, 3) if the mesh has no area.

    Notes
    -----
    Nothing random is in it: the k-th point lies in the triangle that holds the share (k + 1/2) / N of the
    summed area, at the k-th place of the R2 sequence (Roberts 2018, "The unreasonable effectiveness of
    quasirandom sequences"), folded into the triangle. A flat wall of many triangles and one of two get the
    same density. O(F + N log F).
    """
    summed = np.cumsum(mesh.areas())
    if not len(summed) or not summed[-1] > 0.0:
        return np.zeros((0, 3))
    number = np.arange(count)
    share = (number + 0.5) / count * summed[-1]
    chosen = mesh.triangles[np.minimum(np.searchsorted(summed, share, side="right"), len(summed) - 1)]
    u, v = ((0.5 + step * (number + 1.0)) % 1.0 for step in _STEPS)
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u), np.where(outside, 1.0 - v, v)
    a, b, c = (mesh.vertices[chosen[:, k]] for k in range(3))
    return np.asarray(a + u[:, None] * (b - a) + v[:, None] * (c - a))
