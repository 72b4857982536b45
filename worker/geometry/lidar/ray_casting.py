"""Rays against triangles: what a beam hits first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.lidar.scene import Scene

MISS = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """Hold what N rays hit first.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Hit positions in the scene's frame [m]; a ray that hits nothing has infinity here.
    distances : ndarray of shape (N,), float64
        Distance from the ray's origin [m]; infinity where nothing is hit.
    object_ids : ndarray of shape (N,), int64
        The object hit, or `MISS`.
    """

    points: NDArray[np.float64]
    distances: NDArray[np.float64]
    object_ids: NDArray[np.int64]


def cast_rays(
    scene: Scene,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> Hits:
    """Return the first surface that each ray meets.

    Parameters
    ----------
    scene : Scene
        The triangles.
    origins : ndarray of shape (N, 3), float64
        Starts of the rays in the scene's frame [m].
    directions : ndarray of shape (N, 3), float64
        Their directions; any length but zero.

    Returns
    -------
    Hits
        One entry a ray, in the rays' order.

    Raises
    ------
    ValueError
        If the shapes disagree, or a ray is not finite or has no direction.

    Notes
    -----
    Open3D's ``RaycastingScene`` (Embree, single precision: about 1e-6 of the distance), 2-3 million rays a
    second on two cores. Open3D costs 2-3 s to import and is imported here, at the first call, and nowhere
    else in this package. Origins are shifted to the scene's middle first, which keeps single precision
    good far from the origin of the frame.
    """
    if origins.ndim != 2 or origins.shape[1] != 3 or directions.shape != origins.shape:
        msg = f"rays are two (N, 3) arrays, not {origins.shape} and {directions.shape}"
        raise ValueError(msg)
    norms = np.linalg.norm(directions, axis=1, keepdims=True)
    if not (np.isfinite(origins).all() and np.isfinite(norms).all() and (norms > 0).all()):
        msg = "rays are finite and have a direction"
        raise ValueError(msg)
    count = len(origins)
    if count == 0 or len(scene.triangles) == 0:
        return Hits(np.full((count, 3), np.inf), np.full(count, np.inf), np.full(count, MISS))
    unit = directions / norms
    middle = (scene.vertices.min(axis=0) + scene.vertices.max(axis=0)) / 2.0
    distances, primitives = _first_hits(scene, middle, origins - middle, unit)
    hit = np.isfinite(distances)
    points = np.full((count, 3), np.inf)
    points[hit] = origins[hit] + distances[hit, None] * unit[hit]
    object_ids = np.full(count, MISS, dtype=np.int64)
    object_ids[hit] = scene.object_ids[primitives[hit]]
    return Hits(points, distances, object_ids)


def _first_hits(
    scene: Scene,
    middle: NDArray[np.float64],
    origins: NDArray[np.float64],
    unit: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return distances [m] and triangle indices; origins are relative to `middle`."""
    import open3d as o3d  # noqa: PLC0415  - 2-3 s and 200 MiB: only who casts rays pays

    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(
        o3d.core.Tensor.from_numpy((scene.vertices - middle).astype(np.float32)),
        o3d.core.Tensor.from_numpy(scene.triangles.astype(np.uint32)),
    )
    rays = np.concatenate([origins, unit], axis=1).astype(np.float32)
    answer = caster.cast_rays(o3d.core.Tensor.from_numpy(rays))
    distances = answer["t_hit"].numpy().astype(np.float64)
    primitives = answer["primitive_ids"].numpy().astype(np.int64)
    return distances, primitives
