"""The last step of a placement: points pulled onto the planes they lie on, outliers let go."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.registration.ndt import ALL_SIX, LEVELLED, moved
from worker.geometry.registration.surfaces import Surfaces

_ROUNDS = ((0.5, 5), (0.35, 5), (0.25, 12), (0.25, 20))
"""Reach [m] and most steps of each round; all points take part in the last."""
_LEVELLED_ROUNDS = 2
_ROUGH_POINTS = 1500
_TILT_PRIOR = np.deg2rad(1.0)
_PRIOR_NOISE = 0.02
_LEAST_MATCHES = 20


@dataclass(frozen=True, eq=False)
class Refined:
    """Hold a refined pose, whether its last step was small, and the number of steps."""

    T_map_scan: Transform
    converged: bool
    iterations: int


def refine_to_surfaces(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    surfaces: Surfaces,
    *,
    initial: Transform,
    thorough: bool = True,
    tolerance: float = 5e-4,
) -> Refined:
    """Return the pose near `initial` that puts the points onto the surfaces, robustly.

    Points farther from every surface than a reach that narrows from 0.5 to 0.25 m take no part: the target
    object, which the map lacks, neither helps nor harms. Tilt is solved for in the last rounds only, and held
    by a prior of 1 degree, since tablets know where up is.

    Parameters
    ----------
    points, normals : ndarrays of shape (N, 3), float64
        The thinned scan in frame `scan` [m]; zero normals where the surface is not flat.
    surfaces : Surfaces
        In frame `map`.
    initial : Transform
        `T_map_scan`, within a few decimetres and degrees.
    thorough : bool
        Whether all points take part in a last round, or only some 1500, which is enough to tell poses apart.
    tolerance : float
        A step that moves the points by less ends a round [m].

    Notes
    -----
    Gauss-Newton on point-to-plane distances with Tukey's biweight (Chen & Medioni 1992; Zhang 1994).
    O(N log M) a step.
    """
    pose, iterations, small = initial, 0, False
    lever = max(float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1)))), 1e-3)
    some = slice(None, None, 1 + len(points) // _ROUGH_POINTS)
    for nth, (reach, steps) in enumerate(_ROUNDS if thorough else _ROUNDS[:-1]):
        unknowns = np.array(LEVELLED if nth < _LEVELLED_ROUNDS else ALL_SIX)
        used = slice(None) if nth == len(_ROUNDS) - 1 else some
        for _ in range(steps):
            step = _step(points[used], normals[used], surfaces, pose=pose, reach=reach, unknowns=unknowns)
            if step is None:
                return Refined(pose, False, iterations)
            xi, centre = step
            pose = moved(pose, xi, centre)
            iterations += 1
            small = bool(np.linalg.norm(xi[:3]) + lever * np.linalg.norm(xi[3:]) < tolerance)
            if small:
                break
    return Refined(pose, small, iterations)


def _step(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    surfaces: Surfaces,
    *,
    pose: Transform,
    reach: float,
    unknowns: NDArray[np.intp],
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return one Gauss-Newton step (v, w) about a centre, or None when too little is matched."""
    placed = pose.apply(points)
    distance, plane, found = surfaces.match(placed, normals @ pose.rotation.T, reach=reach)
    found &= np.abs(distance) < reach
    if np.count_nonzero(found) < _LEAST_MATCHES:
        return None
    p, r, n = placed[found], distance[found], plane[found]
    weight = (1.0 - (r / reach) ** 2) ** 2
    centre: NDArray[np.float64] = p.mean(axis=0)
    J = np.hstack([n, np.cross(p - centre, n)])
    H = (J * weight[:, None]).T @ J
    g = J.T @ (weight * r)
    up = pose.rotation[:, 2]
    tilt = np.array([up[1], -up[0]])  # the small turn about x and y that would bring the scan upright
    prior = len(p) * (_PRIOR_NOISE / _TILT_PRIOR) ** 2 / 100.0
    H[3, 3] += prior
    H[4, 4] += prior
    g[3:5] -= prior * tilt
    H, g = H[np.ix_(unknowns, unknowns)], g[unknowns]
    xi = np.zeros(6)
    xi[unknowns] = np.linalg.solve(H + 1e-6 * len(p) * np.eye(len(g)), -g)
    return _limited(xi, reach), centre


def _limited(xi: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Return the step, shortened where it would carry points farther than they can be matched."""
    size = max(float(np.linalg.norm(xi[:3])) / reach, float(np.linalg.norm(xi[3:])) / 0.1)
    return xi / size if size > 1.0 else xi
