"""A simulated tablet scan: a person turns and walks with the tablet, which sees 5 m far (paper, section 2.3).

Frame `scan`, as gravity-aligned tablet apps give it: z up, the origin at the place where the tablet was held
when the scan began (not on the floor), x where it then looked, levelled. So `T_map_scan` is a translation to
that place and a yaw, and no more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from service.domain.transform import Transform
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.lidar.ray_casting import MISS, cast_rays
from worker.geometry.lidar.scene import Scene

HELD_HEIGHT = 1.4
_SWAY = 0.01


@dataclass(frozen=True)
class TabletSensor:
    """Hold what a tablet's depth camera sees of one frame.

    Parameters
    ----------
    max_range : float
        Farther surfaces give no point [m].
    noise : float
        Standard deviation of the measured distance [m].
    columns, rows : int
        Depth pixels kept of one frame.
    horizontal_view, vertical_view : float
        Opening angles [rad].
    detail : float
        One point is kept in a cube of this edge [m], as apps do before they export.
    """

    max_range: float = 5.0
    noise: float = 0.01
    columns: int = 96
    rows: int = 72
    horizontal_view: float = np.deg2rad(60.0)
    vertical_view: float = np.deg2rad(48.0)
    detail: float = 0.02


@dataclass(frozen=True, eq=False)
class TabletPath:
    """Hold P poses of the tablet.

    Parameters
    ----------
    positions : ndarray of shape (P, 3), float64
        Where the lens is, in the scene's frame [m].
    yaws, pitches : ndarray of shape (P,), float64
        Where it looks: turn about z from x, and elevation above the horizon [rad].

    Raises
    ------
    ValueError
        If there is no pose or the shapes disagree.
    """

    positions: NDArray[np.float64]
    yaws: NDArray[np.float64]
    pitches: NDArray[np.float64]

    def __post_init__(self) -> None:
        count = len(self.positions)
        if count == 0 or self.positions.shape != (count, 3):
            msg = f"a path is (P, 3) positions with P >= 1, not {self.positions.shape}"
            raise ValueError(msg)
        if self.yaws.shape != (count,) or self.pitches.shape != (count,):
            msg = f"{count} positions need {count} yaws and pitches"
            raise ValueError(msg)

    @classmethod
    def turning(
        cls,
        at: ArrayLike,
        *,
        start_yaw: float,
        turn: float = 2.0 * np.pi,
        frames: int = 48,
        height: float = HELD_HEIGHT,
    ) -> Self:
        """Return the path of a person who stands still and turns once, nodding the tablet up and down.

        Parameters
        ----------
        at : array of shape (2,)
            Where the person stands [m].
        start_yaw : float
            Where the tablet looks first [rad].
        turn : float
            How far it is turned, to the left if positive [rad].
        frames : int
            Number of poses.
        height : float
            Height of the lens above z = 0 [m].
        """
        x, y = np.asarray(at, dtype=np.float64)
        step = np.linspace(0.0, 1.0, frames)
        positions = np.column_stack([np.full(frames, x), np.full(frames, y), np.full(frames, height)])
        return cls(positions, start_yaw + turn * step, _nodding(frames))

    @classmethod
    def walking(
        cls,
        waypoints: ArrayLike,
        *,
        look_at: ArrayLike,
        frames: int = 48,
        height: float = HELD_HEIGHT,
    ) -> Self:
        """Return the path of a person who walks along waypoints with the tablet held towards one place.

        Parameters
        ----------
        waypoints : array of shape (W, 2), W >= 2
            Corners of the walk [m], taken at even speed.
        look_at : array of shape (2,)
            What the tablet is held towards [m].
        frames : int
            Number of poses.
        height : float
            Height of the lens above z = 0 [m].

        Raises
        ------
        ValueError
            If there are fewer than two waypoints, or they are all the same place.
        """
        corners = np.asarray(waypoints, dtype=np.float64)
        legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        gone = np.concatenate([[0.0], np.cumsum(legs)])
        if len(corners) < 2 or not gone[-1] > 0:
            msg = "a walk has at least two different waypoints"
            raise ValueError(msg)
        along = np.linspace(0.0, gone[-1], frames)
        x, y = (np.interp(along, gone, corners[:, axis]) for axis in (0, 1))
        target = np.asarray(look_at, dtype=np.float64)
        yaws = np.unwrap(np.arctan2(target[1] - y, target[0] - x))
        return cls(np.column_stack([x, y, np.full(frames, height)]), yaws, _nodding(frames))

    def then(self, other: TabletPath) -> TabletPath:
        """Return this path with another one walked after it."""
        return TabletPath(
            np.concatenate([self.positions, other.positions]),
            np.concatenate([self.yaws, other.yaws]),
            np.concatenate([self.pitches, other.pitches]),
        )


@dataclass(frozen=True, eq=False)
class TabletScan:
    """Hold a simulated scan with what only a simulation knows.

    Parameters
    ----------
    cloud : PointCloud
        N points in frame `scan` (see the module), all `Label.UNKNOWN`.
    object_ids : ndarray of shape (N,), int64
        Which object of the scene a point lies on.
    T_map_scan : Transform
        The truth: from frame `scan` to the scene's frame.
    """

    cloud: PointCloud
    object_ids: NDArray[np.int64]
    T_map_scan: Transform


def scan_with_tablet(
    scene: Scene,
    path: TabletPath,
    *,
    seed: int,
    sensor: TabletSensor | None = None,
) -> TabletScan:
    """Return what a tablet records on its way through a scene; the same seed gives the same points.

    Points carry noise along the beam. The tablet's own tracking is taken as perfect: a real one drifts by
    centimetres over a room, which bends the cloud, and this one does not.

    Parameters
    ----------
    scene : Scene
        What is there, z up.
    path : TabletPath
        Where the tablet goes; hands add a sway of 1 cm and half a degree.
    seed : int
        Seed of sway and noise.
    sensor : TabletSensor, optional
        Its depth camera.

    Returns
    -------
    TabletScan
        Points, their objects, and the true pose.

    Raises
    ------
    ValueError
        If the tablet sees nothing within its range.
    """
    sensor = sensor or TabletSensor()
    rng = np.random.default_rng(seed)
    swayed = _swayed(path, rng)
    origins, directions = _beams(swayed, sensor, rng)
    hits = cast_rays(scene, origins, directions)
    seen = (hits.object_ids != MISS) & (hits.distances <= sensor.max_range)
    if not seen.any():
        msg = f"nothing lies within {sensor.max_range} m of the tablet"
        raise ValueError(msg)
    measured = hits.distances[seen] + rng.normal(0.0, sensor.noise, int(seen.sum()))
    points = origins[seen] + measured[:, None] * directions[seen]
    keep = _one_a_cube(points, sensor.detail)
    start = swayed.positions[0]
    T_map_scan = Transform.from_xyz_yaw(start[0], start[1], start[2], float(swayed.yaws[0]))
    return TabletScan(
        cloud=PointCloud.of(T_map_scan.inverse().apply(points[keep])),
        object_ids=hits.object_ids[seen][keep],
        T_map_scan=T_map_scan,
    )


def _nodding(frames: int) -> NDArray[np.float64]:
    """Return elevations that go between 35 degrees down and 20 up, seven times on the way [rad]."""
    phase = np.linspace(0.0, 14.0 * np.pi, frames)
    elevation: NDArray[np.float64] = np.deg2rad(-7.5 + 27.5 * np.sin(phase))
    return elevation


def _swayed(path: TabletPath, rng: np.random.Generator) -> TabletPath:
    count = len(path.positions)
    return TabletPath(
        path.positions + rng.normal(0.0, _SWAY, (count, 3)),
        path.yaws + np.deg2rad(rng.normal(0.0, 0.5, count)),
        path.pitches + np.deg2rad(rng.normal(0.0, 0.5, count)),
    )


def _beams(
    path: TabletPath,
    sensor: TabletSensor,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and unit directions of all depth pixels of all frames, (P * rows * columns, 3)."""
    poses, pixels = len(path.positions), sensor.rows * sensor.columns
    across = np.tan(sensor.horizontal_view / 2.0) * np.linspace(1.0, -1.0, sensor.columns)
    up = np.tan(sensor.vertical_view / 2.0) * np.linspace(1.0, -1.0, sensor.rows)
    left, top = np.meshgrid(across, up)
    spacing = 2.0 * np.tan(sensor.horizontal_view / 2.0) / sensor.columns
    camera = np.stack([np.ones(pixels), left.ravel(), top.ravel()], axis=1)
    rays = np.broadcast_to(camera, (poses, pixels, 3)).copy()
    rays[:, :, 1:] += rng.uniform(-0.5, 0.5, (poses, pixels, 2)) * spacing
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    turns = np.stack(
        [
            Transform.from_xyz_rpy((0.0, 0.0, 0.0), (0.0, -pitch, yaw)).rotation
            for yaw, pitch in zip(path.yaws, path.pitches, strict=True)
        ],
    )
    directions = np.einsum("pij,pnj->pni", turns, rays).reshape(-1, 3)
    return np.repeat(path.positions, pixels, axis=0), directions


def _one_a_cube(points: NDArray[np.float64], edge: float) -> NDArray[np.int64]:
    """Return the indices, rising, of the first point in every cube of a grid."""
    cubes = np.floor(points / edge).astype(np.int64)
    cubes -= cubes.min(axis=0)
    size = cubes.max(axis=0) + 1
    keys = (cubes[:, 0] * size[1] + cubes[:, 1]) * size[2] + cubes[:, 2]
    first = np.unique(keys, return_index=True)[1]
    return np.sort(first)
