"""The step of Newton's method that stays inside a ball."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_NEWTON_STEPS, _LONGER = 50, 1e-9


@njit(cache=True)
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
    g = np.sum(vectors * gradient.reshape(-1, 1), axis=0)
    floor = max(1e-9 * np.abs(values).max(), 1e-12)
    damping = _damping(values, g**2, radius, max(0.0, floor - values[0]))
    step = np.sum(vectors * (g / (values + damping)), axis=1)
    step *= min(1.0, radius / max(np.sqrt(np.sum(step**2)), 1e-300))
    bent = np.sum(hessian * step.reshape(-1, 1) * step)
    return step, max(np.sum(gradient * step) + 0.5 * bent, 0.0)


@njit(cache=True)
def _damping(values: NDArray[np.float64], squares: NDArray[np.float64], radius: float, least: float) -> float:
    """Return the damping at which the step is as long as the radius, or the least if it is shorter there.

    Newton's method on 1 / length, which is nearly straight in the damping: from too long a step it never
    goes past the root.
    """
    damping = least
    for _ in range(_NEWTON_STEPS):
        square = np.sum(squares / (values + damping) ** 2)
        length = np.sqrt(square)
        if length <= radius * (1.0 + _LONGER):
            break
        damping += (length / radius - 1.0) * square / np.sum(squares / (values + damping) ** 3)
    return damping
