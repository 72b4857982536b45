"""What a scan is placed on: the exact faces of walls where they are known, else the points of a cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import FileEmpty
from service.domain.evidence import MapKind
from worker.geometry.drawing.reading.reading import Column, Wall
from worker.geometry.registration.cell_moments import cell_moments
from worker.geometry.registration.cloud_outline import CloudOutline
from worker.geometry.registration.cloud_surfaces import CloudSurfaces
from worker.geometry.registration.faces import Faces
from worker.geometry.registration.search import Outline
from worker.geometry.registration.surfaces import Surfaces, estimate_normals

_UP_STEP = 0.15
_PLANE_STEP = 0.15
_CLOUD_STEP = 0.05


@dataclass(frozen=True, eq=False)
class PlacementTarget:
    """Hold a map to place scans on; sampled only around the place that is asked for.

    Parameters
    ----------
    kind : {"faces", "cloud"}
        What the map gave.
    points : ndarray of shape (M, 3), float64
        The cloud, or the layers already on a map of faces [m]; may be empty for faces.
    faces : Faces, optional
        The upright faces, where they are known.
    wall_height : float
        Height of the faces above z = 0 [m].
    ceiling : bool
        Whether a ceiling at the wall height is known.
    """

    kind: MapKind
    points: NDArray[np.float64]
    faces: Faces | None = None
    wall_height: float = 0.0
    ceiling: bool = False

    @classmethod
    def from_cloud(cls, points: NDArray[np.float64]) -> PlacementTarget:
        """Return a target that is a cloud alone, (M, 3) in frame `map` [m].

        Raises
        ------
        FileEmpty
            If there is no point.
        """
        if not len(points):
            raise FileEmpty("The map holds no point, so nothing can be placed on it.")
        return cls("cloud", points)

    @classmethod
    def from_faces(
        cls,
        walls: Sequence[Wall],
        columns: Sequence[Column] = (),
        *,
        wall_height: float,
        ceiling: bool = False,
        layers: NDArray[np.float64] | None = None,
    ) -> PlacementTarget:
        """Return a target of exact faces, with the floor at z = 0, which a map from a drawing stands on.

        The floor is used for the height whether or not the map's cloud shows it.

        Parameters
        ----------
        walls, columns : sequence
            In frame `map`.
        wall_height : float
            Height of the walls [m].
        ceiling : bool
            Whether there is a ceiling at that height.
        layers : ndarray of shape (M, 3), optional
            Points of scans that were placed before [m].

        Raises
        ------
        FileEmpty
            If there is no wall and no column.
        """
        if not walls and not columns:
            raise FileEmpty("The map holds no wall, so nothing can be placed on it.")
        points = np.zeros((0, 3)) if layers is None else layers
        return cls("faces", points, Faces.of(walls, columns), wall_height, ceiling)

    @cached_property
    def outline(self) -> Outline:
        """Return the walls seen from above, for a placement search."""
        return self.faces if self.faces is not None else CloudOutline.of(self.points)

    @cached_property
    def cloud_surfaces(self) -> CloudSurfaces:
        """Return the surfaces of the cloud, found where they are asked for."""
        return CloudSurfaces.of(self.points)

    def near(self, centre: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
        """Return the (K, 3) points of the cloud within `radius` [m] of `centre` (3,), seen from above."""
        inside = np.sum((self.points[:, :2] - centre[:2]) ** 2, axis=1) < radius**2
        near: NDArray[np.float64] = self.points[inside]
        return near

    def seen_through(
        self,
        points: NDArray[np.float64],
        *,
        viewpoint: NDArray[np.float64],
        clearance: float = 0.25,
        give: float = 0.0,
    ) -> NDArray[np.bool_]:
        """Return which points stand behind a wall of the map as seen from the tablet.

        Parameters
        ----------
        points : ndarray of shape (N, 3), float64
            Placed points below the walls' upper edge, in frame `map` [m].
        viewpoint : ndarray of shape (3,), float64
            Where the tablet was [m]. A tablet that walked around a corner has seen behind it rightly.
        clearance : float
            The wall is crossed at least so far before the point [m].
        give : float
            And it would be so if the walls stood this much to any side of where the map has them [m].

        Returns
        -------
        ndarray of shape (N,), bool
            All False where the map is a cloud: it has no walls.
        """
        if self.faces is None or not len(points):
            return np.zeros(len(points), dtype=bool)
        return self.faces.hidden_from(viewpoint[:2], points[:, :2], clearance=clearance, give=give)

    def around(
        self, centre: NDArray[np.float64], radius: float, *, eye: NDArray[np.float64], top: float = 0.0
    ) -> Surfaces:
        """Return the surfaces within `radius` [m] of `centre` (3,), seen from above.

        Of a cloud those that can be seen from `eye` (3,) [m]. A drawing does not tell how high its walls are:
        where no ceiling is known they go on up to `top` [m].
        """
        if self.faces is None:
            return self.cloud_surfaces.around(centre, radius, eye=eye)
        cloud = _cloud_surfaces(self.near(centre, radius))
        height = self.wall_height if self.ceiling else max(self.wall_height, top)
        parts = [
            _walls(self.faces, centre, radius, height),
            _plane(centre, radius, 0.0, 1.0),
        ]
        if self.ceiling:
            parts.append(_plane(centre, radius, self.wall_height, -1.0))
        parts += [(cloud.points, cloud.normals), (cloud.points, -cloud.normals)]  # the inside is unknown
        return Surfaces(np.vstack([p for p, _ in parts]), np.vstack([n for _, n in parts]), sided=True)


def _cloud_surfaces(points: NDArray[np.float64]) -> Surfaces:
    """Return a thinned cloud with normals from its neighbours; zero where they are no surface."""
    if len(points) < 3:
        return Surfaces(points, np.zeros_like(points), sided=False)
    thinned = cell_moments(points, _CLOUD_STEP).means
    normals, _ = estimate_normals(thinned)
    return Surfaces(thinned, normals, sided=False)


def _walls(
    faces: Faces, centre: NDArray[np.float64], radius: float, height: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return samples on the upright faces near a place, and their normals."""
    feet, outward = faces.samples
    near = np.sum((feet - centre[:2]) ** 2, axis=1) < radius**2
    feet, outward = feet[near], outward[near]
    levels = np.arange(0.5 * _UP_STEP, height, _UP_STEP)
    points = np.column_stack([np.repeat(feet, len(levels), axis=0), np.tile(levels, len(feet))])
    normals = np.column_stack([np.repeat(outward, len(levels), axis=0), np.zeros(len(points))])
    return points, normals


def _plane(
    centre: NDArray[np.float64], radius: float, z: float, up: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return samples on a level plane near a place, on a lattice from the frame's origin."""
    low, high = np.floor((centre[:2] - radius) / _PLANE_STEP), np.ceil((centre[:2] + radius) / _PLANE_STEP)
    x, y = np.meshgrid(*(np.arange(low[i], high[i]) * _PLANE_STEP for i in range(2)), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, z)])
    points = points[np.sum((points[:, :2] - centre[:2]) ** 2, axis=1) < radius**2]
    normals = np.tile([0.0, 0.0, up], (len(points), 1))
    return points, normals
