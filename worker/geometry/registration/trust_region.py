"""The step of Newton's method that stays inside a ball."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_NEWTON_STEPS, _LONGER = 50, 1e-9


def trust_region_step(
    gradient: NDArray[np.float64], hessian: NDArray[np.float64], radius: float
) -> tuple[NDArray[np.float64], float]:
    """Return the step at which the quadratic model of a score is highest within `radius`, and its gain.

    Parameters
    ----------
    gradient : ndarray of shape (K,)
        Of the score to be maximised.
    hessian : ndarray of shape (K, K)
        Of the score; it need not be negative definite.
    radius : float
        Longest step allowed.

    Returns
    -------
    tuple
        Step (K,), and how much the model rises along it (at least 0).

    Notes
    -----
    Moré & Sorensen 1983 by eigenvalues: the least damping lambda >= 0 for which ``lambda I - H`` is
    positive definite and the step fits. In the so-called hard case the step is merely shorter.
    """
    values, vectors = np.linalg.eigh(-hessian)
    g = vectors.T @ gradient
    floor = max(1e-9 * float(np.abs(values).max()), 1e-12)
    damping = _damping(values.tolist(), (g**2).tolist(), radius, least=max(0.0, floor - float(values[0])))
    step = vectors @ (g / (values + damping))
    step *= min(1.0, radius / max(float(np.sqrt(step @ step)), 1e-300))
    return step, max(float(gradient @ step + 0.5 * step @ hessian @ step), 0.0)


def _damping(values: list[float], squares: list[float], radius: float, *, least: float) -> float:
    """Return the damping at which the step is as long as the radius, or the least if it is shorter there.

    Newton's method on 1 / length, which is nearly straight in the damping: from too long a step it never
    goes past the root.
    """
    damping = least
    for _ in range(_NEWTON_STEPS):
        square = sum(g / (v + damping) ** 2 for v, g in zip(values, squares, strict=True))
        length = math.sqrt(square)
        if length <= radius * (1.0 + _LONGER):
            break
        slope = sum(g / (v + damping) ** 3 for v, g in zip(values, squares, strict=True))
        damping += (length / radius - 1.0) * square / slope
    return damping
