"""The last step of a placement: points pulled onto the planes they lie on, outliers let go."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.registration.ndt import ALL_SIX, LEVELLED, motion
from worker.geometry.registration.surfaces import Surfaces

_ROUNDS = ((0.5, 5), (0.35, 5), (0.25, 12), (0.25, 20))
"""Reach [m] and most steps of each round; all points take part in the last."""
_LEVELLED_ROUNDS = 2
_ON_COARSE = ((0.5, 5), (0.35, 5), (0.25, 12), (0.05, 20))
_ASIDE = 0.5
_TURNS = np.deg2rad([0.0, 1.0, -1.0, 2.0, -2.0])
"""The same on coarse surfaces, how far aside their points may be [m], and from where the last round begins.

Such a cloud often has but the far face of a wall, which pulls the pose aside until it is let go.
"""
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
    done = Refined(initial, False, 0)
    rounds = _ON_COARSE if surfaces.coarse else _ROUNDS
    some = slice(None, None, 1 + len(points) // _ROUGH_POINTS)
    for nth, (reach, steps) in enumerate(rounds if thorough else rounds[:-1]):
        unknowns = np.array(LEVELLED if surfaces.coarse or nth < _LEVELLED_ROUNDS else ALL_SIX)
        few = _Fit(points[some], normals[some], surfaces, reach, unknowns)
        last = nth == len(rounds) - 1
        if last and surfaces.coarse:
            ends = [_descend(few, start, steps, tolerance) for start in _turned(few, done.T_map_scan.matrix)]
            best = max(ends, key=lambda end: _agreement(few, end.T_map_scan.matrix))
            done = Refined(best.T_map_scan, False, done.iterations + sum(end.iterations for end in ends))
        fit = replace(few, points=points, normals=normals) if last else few
        end = _descend(fit, done.T_map_scan.matrix, steps, tolerance)
        done = Refined(end.T_map_scan, end.converged, done.iterations + end.iterations)
    return done


@dataclass(frozen=True, eq=False)
class _Fit:
    """Hold what a round fits: points with normals to surfaces within a reach, in some unknowns."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    surfaces: Surfaces
    reach: float
    unknowns: NDArray[np.intp]

    def matched(
        self, pose: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the points within reach, their distances, the normals there, and Tukey's weights."""
        turn, aside = pose[:3, :3], _ASIDE if self.surfaces.coarse else 0.0
        placed = self.points @ turn.T + pose[:3, 3]
        distance, plane, found = self.surfaces.match(
            placed, self.normals @ turn.T, reach=max(self.reach, aside)
        )
        found &= np.abs(distance) < self.reach
        return placed[found], distance[found], plane[found], (1.0 - (distance[found] / self.reach) ** 2) ** 2


def _turned(fit: _Fit, pose: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return a pose and others a degree or two to each side of it."""
    centre = pose[:3, :3] @ fit.points.mean(axis=0) + pose[:3, 3]
    return [motion(np.array([0.0, 0.0, 0.0, 0.0, 0.0, turn]), centre) @ pose for turn in _TURNS]


def _agreement(fit: _Fit, pose: NDArray[np.float64]) -> float:
    return float(fit.matched(pose)[3].sum())


def _descend(fit: _Fit, start: NDArray[np.float64], steps: int, tolerance: float) -> Refined:
    """Return where Gauss-Newton steps lead; not converged where too little is matched."""
    pose, small, taken = start, False, 0
    spread = fit.points - fit.points.mean(axis=0)
    lever = max(float(np.sqrt(np.mean(np.sum(spread**2, axis=1)))), 1e-3)
    while taken < steps and not small:
        step = _step(fit, pose)
        if step is None:
            return Refined(Transform(pose), False, taken)
        xi, centre = step
        pose = motion(xi, centre) @ pose
        taken += 1
        small = bool(np.linalg.norm(xi[:3]) + lever * np.linalg.norm(xi[3:]) < tolerance)
    return Refined(Transform(pose), small, taken)


def _step(fit: _Fit, pose: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return one Gauss-Newton step (v, w) about a centre, or None when too little is matched."""
    p, r, n, weight = fit.matched(pose)
    if len(p) < _LEAST_MATCHES:
        return None
    centre: NDArray[np.float64] = p.mean(axis=0)
    J = np.hstack([n, np.cross(p - centre, n)])
    H = (J * weight[:, None]).T @ J
    g = J.T @ (weight * r)
    up = pose[:3, 2]
    tilt = np.array([up[1], -up[0]])  # the small turn about x and y that would bring the scan upright
    prior = len(p) * (_PRIOR_NOISE / _TILT_PRIOR) ** 2 / 100.0
    H[3, 3] += prior
    H[4, 4] += prior
    g[3:5] -= prior * tilt
    free = fit.unknowns
    H, g = H[np.ix_(free, free)], g[free]
    xi = np.zeros(6)
    xi[free] = np.linalg.solve(H + 1e-6 * len(p) * np.eye(len(g)), -g)
    return _limited(xi, fit.reach), centre


def _limited(xi: NDArray[np.float64], reach: float) -> NDArray[np.float64]:
    """Return the step, shortened where it would carry points farther than they can be matched."""
    size = max(float(np.linalg.norm(xi[:3])) / reach, float(np.linalg.norm(xi[3:])) / 0.1)
    return xi / size if size > 1.0 else xi
