"""A room of known geometry, and scans of it with known truth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall
from worker.geometry.registration.target import PlacementTarget

CORNERS = np.array([[0, 0], [6.2, 0], [6.2, 2.4], [4.7, 2.4], [4.7, 4.6], [0, 4.6]], dtype=np.float64)
HEIGHT = 2.5
THICKNESS = 0.2


def walls(corners: NDArray[np.float64] = CORNERS) -> tuple[Wall, ...]:
    """Return walls whose inner faces are the outline, which runs with the room on its left."""
    ring = np.vstack([corners, corners[:1]])
    made = []
    for a, b in pairwise(ring):
        along = (b - a) / np.linalg.norm(b - a)
        outward = np.array([along[1], -along[0]])
        made.append(Wall.of(np.array([a, b]) + outward * THICKNESS / 2, thickness=THICKNESS))
    return tuple(made)


def inside(seed: int, sides: tuple[int, ...] | None = None, *, floor: bool = True) -> NDArray[np.float64]:
    """Return points on the inner faces and the floor, in frame `map`, with 1 cm of noise."""
    rng = np.random.default_rng(seed)
    ring = np.vstack([CORNERS, CORNERS[:1]])
    parts = []
    for k in range(len(CORNERS)) if sides is None else sides:
        a, b = ring[k], ring[k + 1]
        n = int(400 * np.linalg.norm(b - a) * HEIGHT)
        s = rng.uniform(0, 1, (n, 1))
        parts.append(np.column_stack([a + s * (b - a), rng.uniform(0, HEIGHT - 0.1, n)]))
    if floor:
        ground = np.column_stack([rng.uniform(0, 4.7, 6000), rng.uniform(0, 4.6, 6000), np.zeros(6000)])
        parts.append(ground)
    points = np.vstack(parts)
    return points + rng.normal(0, 0.01, points.shape)


def box(seed: int, at: tuple[float, float] = (2.0, 2.5)) -> NDArray[np.float64]:
    """Return points on a box of 1 m that the map lacks."""
    rng = np.random.default_rng(seed + 999)
    u = rng.uniform(0, 1, (3000, 2))
    side = rng.integers(0, 5, 3000)
    zeros, ones = np.zeros(3000), np.ones(3000)
    faces = np.stack(
        [
            np.column_stack([zeros, u]), np.column_stack([ones, u]),
            np.column_stack([u[:, 0], zeros, u[:, 1]]), np.column_stack([u[:, 0], ones, u[:, 1]]),
            np.column_stack([u, ones]),
        ]
    )  # fmt: skip
    return faces[side, np.arange(3000)] + [at[0] - 0.5, at[1] - 0.5, 0.0]


@dataclass(frozen=True, eq=False)
class Case:
    """Hold a scan in its own frame, the true pose, and the map of faces."""

    scan: PointCloud
    truth: Transform
    target: PlacementTarget


def a_case(
    seed: int, *, sides: tuple[int, ...] | None = None, floor: bool = True, with_box: bool = True
) -> Case:
    """Return a scan of the room, taken from (3.4, 1.6, 1.4) at some yaw."""
    rng = np.random.default_rng(seed)
    truth = Transform.from_xyz_yaw(3.4, 1.6, 1.4, float(rng.uniform(-np.pi, np.pi)))
    points = inside(seed, sides, floor=floor)
    if with_box:
        points = np.vstack([points, box(seed)])
    target = PlacementTarget.from_faces(walls(), wall_height=HEIGHT)
    return Case(PointCloud.of(truth.inverse().apply(points)), truth, target)


def off(truth: Transform, dx: float, dy: float, dyaw_deg: float, *, dz: float = 0.0) -> Transform:
    """Return a rough pose that far from the truth."""
    x, y, z = truth.translation + np.array([dx, dy, dz])
    return Transform.from_xyz_yaw(float(x), float(y), float(z), truth.rpy[2] + np.deg2rad(dyaw_deg))


def error_of(pose: Transform, truth: Transform) -> tuple[float, float]:
    """Return how far a pose is from the truth, [m] and [degrees]."""
    distance, angle = pose.distance_to(truth)
    return distance, float(np.rad2deg(angle))
