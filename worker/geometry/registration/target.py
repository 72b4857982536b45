"""What a scan is placed on: the exact faces of walls where they are known, else the points of a cloud."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import FileEmpty
from service.domain.evidence import MapKind
from worker.geometry.cloud.voxel_grid import voxel_grid_filter
from worker.geometry.drawing.reading import Column, Wall
from worker.geometry.registration.surfaces import Surfaces, estimate_normals
from worker.geometry.registration.visibility import Solids

ALONG_STEP = 0.05
_UP_STEP = 0.15
_PLANE_STEP = 0.15
_CLOUD_STEP = 0.05


@dataclass(frozen=True, eq=False)
class _Segments:
    """Hold S face segments: begin, end (S, 2), and the direction in which each face looks (S, 2)."""

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    outward: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PlacementTarget:
    """Hold a map to place scans on; sampled only around the place that is asked for.

    Parameters
    ----------
    kind : {"faces", "cloud"}
        What the map gave.
    points : ndarray of shape (M, 3), float64
        The cloud, or the layers already on a map of faces [m]; may be empty for faces.
    segments : optional
        The faces seen from above.
    wall_height : float
        Height of the faces above z = 0 [m].
    ceiling : bool
        Whether a ceiling at the wall height is known.
    solids : optional
        What hides faces that stand against it.
    """

    kind: MapKind
    points: NDArray[np.float64]
    segments: _Segments | None = None
    wall_height: float = 0.0
    ceiling: bool = False
    solids: Solids | None = None

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
        solids = Solids.of(walls, columns)
        return cls("faces", points, _segments(walls, columns), wall_height, ceiling, solids)

    def near(self, centre: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
        """Return the (K, 3) points of the cloud within `radius` [m] of `centre` (3,), seen from above."""
        inside = np.sum((self.points[:, :2] - centre[:2]) ** 2, axis=1) < radius**2
        near: NDArray[np.float64] = self.points[inside]
        return near

    def seen_through(
        self, points: NDArray[np.float64], *, viewpoint: NDArray[np.float64], clearance: float = 0.25
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

        Returns
        -------
        ndarray of shape (N,), bool
            All False where the map is a cloud: it has no walls.
        """
        behind = np.zeros(len(points), dtype=bool)
        if self.segments is None or not len(points):
            return behind
        eye, ray = viewpoint[:2], points[:, :2] - viewpoint[:2]
        length = np.hypot(ray[:, 0], ray[:, 1])
        along = self.segments.end - self.segments.begin
        for k in range(len(along)):
            to = self.segments.begin[k] - eye
            across = ray[:, 0] * along[k, 1] - ray[:, 1] * along[k, 0]
            across = np.where(np.abs(across) < 1e-12, np.inf, across)
            t = (to[0] * along[k, 1] - to[1] * along[k, 0]) / across
            u = (to[0] * ray[:, 1] - to[1] * ray[:, 0]) / across
            behind |= (t > 0.0) & (t * length < length - clearance) & (u >= 0.0) & (u <= 1.0)
        return behind

    def around(self, centre: NDArray[np.float64], radius: float) -> Surfaces:
        """Return the surfaces within `radius` [m] of `centre` (3,), seen from above."""
        cloud = _cloud_surfaces(self.near(centre, radius))
        if self.segments is None:
            return cloud
        parts = [
            _walls(self.segments, self.solids, centre, radius, self.wall_height),
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
    thinned = voxel_grid_filter(points, _CLOUD_STEP)
    normals, _ = estimate_normals(thinned)
    return Surfaces(thinned, normals, sided=False)


def _segments(walls: Sequence[Wall], columns: Sequence[Column]) -> _Segments:
    """Return every face as segments that know their outside."""
    begins, ends, outs = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros((0, 2))]
    for wall in walls:
        for face, side in zip(wall.faces, (1.0, -1.0), strict=True):
            along = np.diff(face, axis=0)
            begins.append(face[:-1])
            ends.append(face[1:])
            outs.append(side * np.column_stack([-along[:, 1], along[:, 0]]))
    for column in columns:
        ring = np.vstack([column.outline, column.outline[:1]])
        x, y = ring[:, 0], ring[:, 1]
        turning = np.sign(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) or 1.0
        along = np.diff(ring, axis=0)
        begins.append(ring[:-1])
        ends.append(ring[1:])
        outs.append(turning * np.column_stack([along[:, 1], -along[:, 0]]))
    begin, end, out = np.vstack(begins), np.vstack(ends), np.vstack(outs)
    length = np.hypot(out[:, 0], out[:, 1])
    kept = length > 1e-9
    return _Segments(begin[kept], end[kept], out[kept] / length[kept, None])


def _walls(
    segments: _Segments,
    solids: Solids | None,
    centre: NDArray[np.float64],
    radius: float,
    height: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return samples on the upright faces near a place, and their normals."""
    along = segments.end - segments.begin
    length = np.hypot(along[:, 0], along[:, 1])
    counts = np.maximum(np.ceil(length / ALONG_STEP).astype(np.int64), 1)
    which = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (place + 0.5) / counts[which]
    foot = segments.begin[which] + share[:, None] * along[which]
    near = np.sum((foot - centre[:2]) ** 2, axis=1) < radius**2
    foot, out = foot[near], segments.outward[which[near]]
    if solids is not None:
        seen = ~solids.hides(foot, out)
        foot, out = foot[seen], out[seen]
    levels = np.arange(0.5 * _UP_STEP, height, _UP_STEP)
    points = np.column_stack([np.repeat(foot, len(levels), axis=0), np.tile(levels, len(foot))])
    normals = np.column_stack([np.repeat(out, len(levels), axis=0), np.zeros(len(points))])
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
