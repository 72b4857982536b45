"""A simulated VLP-16 that stands level in a world: 16 rings from -15 to 15 degrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.lidar.ray_casting import cast_rays
from worker.geometry.lidar.scene import Scene
from worker.geometry.registration.ndt import register_ndt
from worker.geometry.registration.ndt_map import NdtMap

RINGS = np.deg2rad(np.linspace(-15.0, 15.0, 16))
AZIMUTH_STEP = np.deg2rad(0.2)
HEIGHT = 1.0
NOISE = 0.03
NEAREST, FARTHEST = 0.4, 100.0
OFF_M, OFF_YAW = 0.3, np.deg2rad(5.0)


def load_world(path: Path, offset: tuple[float, float]) -> Scene:
    """Return a triangle world, moved by a horizontal offset [m]."""
    with np.load(path, allow_pickle=False) as world:
        vertices = world["v"].astype(np.float64)
        triangles = world["f"].astype(np.int64)
        ids = world["fid"].astype(np.int64)
        names = tuple(str(name) for name in world["names"])
    return Scene(vertices, triangles, ids, names).moved((*offset, 0.0))


def scan(
    scene: Scene, position: NDArray[np.float64], *, every: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return one turn's points (N, 3) [m] relative to the sensor, every so manieth column of the turn."""
    azimuth = np.arange(0.0, 2.0 * np.pi, AZIMUTH_STEP * every)
    turn, ring = np.meshgrid(azimuth, RINGS, indexing="ij")
    along = np.stack([np.cos(ring) * np.cos(turn), np.cos(ring) * np.sin(turn), np.sin(ring)], axis=-1)
    directions = along.reshape(-1, 3)
    origins = np.broadcast_to(position, directions.shape).copy()
    distance = cast_rays(scene, origins, directions).distances
    seen = (distance > NEAREST) & (distance < FARTHEST)
    measured = distance[seen] + rng.normal(0.0, NOISE, int(seen.sum()))
    return np.asarray(measured[:, None] * directions[seen], dtype=np.float64)


def free_points(
    scene: Scene, candidates: NDArray[np.float64], *, count: int, clearance: float
) -> NDArray[np.float64]:
    """Return the first `count` (N, 2) candidates where a robot can stand, as (count, 3) sensor positions."""
    angles = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(72)])
    out: list[NDArray[np.float64]] = []
    for x, y in candidates:
        if len(out) == count:
            break
        nearest = min(
            float(cast_rays(scene, np.tile((x, y, z), (72, 1)), around).distances.min())
            for z in (0.2, 0.6, HEIGHT)
        )
        if nearest >= clearance:
            out.append(np.array([x, y, HEIGHT]))
    return np.array(out)


def starts_off(truth: NDArray[np.float64], rng: np.random.Generator) -> list[Transform]:
    """Return a start 0.3 m and 5 degrees off each of (N, 3) true positions."""
    out = []
    for position in truth:
        angle, turn = rng.uniform(0.0, 2.0 * np.pi), OFF_YAW * rng.choice((-1.0, 1.0))
        shift = OFF_M * np.array([np.cos(angle), np.sin(angle), 0.0])
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        pose[:3, 3] = position + shift
        out.append(Transform(pose))
    return out


def position_errors(
    target: NdtMap,
    scans: Sequence[NDArray[np.float64]],
    starts: Sequence[Transform],
    truth: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the position errors of all scans on the plan and in height, (N, 2) [m]."""
    found = [
        register_ndt(points, target, initial=start).T_target_source.matrix[:3, 3]
        for points, start in zip(scans, starts, strict=True)
    ]
    off = np.array(found) - truth
    return np.column_stack([np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])])
