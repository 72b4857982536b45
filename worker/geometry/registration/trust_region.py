"""The step of Newton's method that stays inside a ball."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_BISECTIONS = 60


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
    low = max(0.0, floor - float(values[0]))

    def length(damping: float) -> float:
        return float(np.linalg.norm(g / (values + damping)))

    damping = low
    if length(low) > radius:
        high = low + float(np.linalg.norm(g)) / radius + floor
        for _ in range(_BISECTIONS):
            damping = 0.5 * (low + high)
            low, high = (damping, high) if length(damping) > radius else (low, damping)
        damping = high
    step = vectors @ (g / (values + damping))
    return step, max(float(gradient @ step + 0.5 * step @ hessian @ step), 0.0)
