"""NDT registration: Newton steps inside a trust region, uphill on the NDT score (Magnusson 2009, 6.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.registration.derivatives import derivatives
from worker.geometry.registration.ndt_map import NdtMap
from worker.geometry.registration.trust_region import trust_region_step

LEVELLED = (0, 1, 2, 5)
"""The unknowns of a scan whose z axis is up: x, y, z and yaw."""
ALL_SIX = (0, 1, 2, 3, 4, 5)
_SHRINK, _GROW = 0.25, 2.0
_RADIUS_SHARE = 0.3
_LEAST_RADIUS = 1e-6


@dataclass(frozen=True, eq=False)
class NdtResult:
    """Hold what the maximisation of the NDT score ended in.

    Parameters
    ----------
    T_target_source : Transform
        The pose found; when `converged` is false, the best of those tried.
    converged : bool
        Whether the last step was shorter than asked before the iterations ran out.
    iterations : int
        Evaluations of score, gradient and Hessian.
    score : float
        The NDT score there: a sum over points, to be divided by their number (TP).
    hessian : ndarray of shape (6, 6)
        Of the score in (v, w) about `centre`; negative definite at a proper maximum.
    centre : ndarray of shape (3,)
        Mean of the placed source points [m].
    """

    T_target_source: Transform
    converged: bool
    iterations: int
    score: float
    hessian: NDArray[np.float64]
    centre: NDArray[np.float64]


def register_ndt(
    source: NDArray[np.float64],
    target: NdtMap,
    *,
    initial: Transform,
    unknowns: tuple[int, ...] = ALL_SIX,
    tolerance: float = 1e-4,
    max_iterations: int = 50,
    on_iteration: Callable[[int], None] | None = None,
) -> NdtResult:
    """Return the pose near `initial` at which the NDT score is locally the highest.

    A local maximum may be a wrong pose: nothing here judges it.

    Parameters
    ----------
    source : ndarray of shape (N, 3), float64
        Points in their own frame [m].
    target : NdtMap
        The map.
    initial : Transform
        `T_target_source` to start from.
    unknowns : tuple of int
        Which of (x, y, z, turn about x, y, z) may change, in the target's axes.
    tolerance : float
        A step that moves the points by less than this ends the search [m].
    max_iterations : int
        The most evaluations.
    on_iteration : callable, optional
        Called with the number of evaluations; may raise to stop.

    Raises
    ------
    ValueError
        If `source` is not (N, 3) with N >= 1.

    Notes
    -----
    Steps are measured in metres: turns are multiplied by the source's root mean square radius. A step is
    taken only if the score rises; otherwise the trust region shrinks (Nocedal & Wright, algorithm 4.1).
    """
    if source.ndim != 2 or source.shape[1] != 3 or len(source) == 0:
        msg = f"source points are (N, 3) with N >= 1, not {source.shape}"
        raise ValueError(msg)
    pose, radius = initial.matrix, _RADIUS_SHARE * target.resolution
    source = np.ascontiguousarray(source, dtype=np.float64)
    middle = source.mean(axis=0)
    lever = max(float(np.sqrt(np.mean(np.sum((source - middle) ** 2, axis=1)))), 1e-3)
    scale = np.array([1.0, 1.0, 1.0, 1.0 / lever, 1.0 / lever, 1.0 / lever])
    keep = np.array(unknowns)
    centre, (score, g, H) = _evaluate(source, target, pose, middle)
    iterations, converged = 1, False
    while iterations < max_iterations and not converged:
        gs, Hs = (g * scale)[keep], (H * np.outer(scale, scale))[np.ix_(keep, keep)]
        step, gain = trust_region_step(gs, Hs, radius)
        length = float(np.linalg.norm(step))
        if length < tolerance:
            converged = True
            break
        xi = np.zeros(6)
        xi[keep] = step
        trial = motion(xi * scale, centre) @ pose
        trial_centre, (trial_score, trial_g, trial_H) = _evaluate(source, target, trial, middle)
        iterations += 1
        if on_iteration is not None:
            on_iteration(iterations)
        ratio = (trial_score - score) / gain if gain > 0.0 else -1.0
        if ratio < _SHRINK:
            radius = _SHRINK * length
        elif ratio > 1.0 - _SHRINK and length > 0.99 * radius:
            radius = min(_GROW * radius, target.resolution)
        if trial_score > score:
            pose, centre, score, g, H = trial, trial_centre, trial_score, trial_g, trial_H
        converged = radius < _LEAST_RADIUS or radius < 0.1 * tolerance
    return NdtResult(Transform(pose), converged, iterations, score, H, centre)


def moved(pose: Transform, xi: NDArray[np.float64], centre: NDArray[np.float64]) -> Transform:
    """Return `pose` followed by the turn ``xi[3:]`` [rad] about `centre` and the shift ``xi[:3]`` [m]."""
    return Transform(motion(xi, centre)) @ pose


def motion(xi: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (4, 4) motion of a turn about a centre and a shift."""
    turn = rotation_matrix(xi[3:])
    m = np.eye(4)
    m[:3, :3] = turn
    m[:3, 3] = centre + xi[:3] - turn @ centre
    return m


def rotation_matrix(w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) turn about the axis `w` by its length [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    cross = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
    if angle < 1e-9:
        a, b = 1.0, 0.5
    else:
        a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    turn: NDArray[np.float64] = np.eye(3) + a * cross + b * cross @ cross
    return turn


def _evaluate(
    source: NDArray[np.float64], target: NdtMap, pose: NDArray[np.float64], middle: NDArray[np.float64]
) -> tuple[NDArray[np.float64], tuple[float, NDArray[np.float64], NDArray[np.float64]]]:
    """Return where the source's middle (3,) is placed, and score, gradient and Hessian about it."""
    centre = pose[:3, :3] @ middle + pose[:3, 3]
    return centre, derivatives(source, target, centre=centre, pose=pose)
