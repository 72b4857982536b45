"""Eigenvalues and eigenvectors of symmetric 3 x 3 matrices, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_SWEEPS = 12


@njit(cache=True)
def eigen(m: NDArray[np.float64], values: NDArray[np.float64], vectors: NDArray[np.float64]) -> None:
    """Write the eigenvalues (3,), ascending, and eigenvectors (3, 3) of one packed matrix (6,)."""
    a00, a01, a02, a11, a12, a22 = m[0], m[1], m[2], m[3], m[4], m[5]
    v00, v01, v02 = 1.0, 0.0, 0.0
    v10, v11, v12 = 0.0, 1.0, 0.0
    v20, v21, v22 = 0.0, 0.0, 1.0
    least = 1e-12 * (abs(a00) + abs(a11) + abs(a22))
    for _ in range(_SWEEPS):
        if abs(a01) + abs(a02) + abs(a12) <= least:
            break
        c, s, t = _turn(a00, a11, a01, least)
        a00, a11, a01 = a00 - t * a01, a11 + t * a01, 0.0
        a02, a12 = c * a02 - s * a12, s * a02 + c * a12
        v00, v01 = c * v00 - s * v01, s * v00 + c * v01
        v10, v11 = c * v10 - s * v11, s * v10 + c * v11
        v20, v21 = c * v20 - s * v21, s * v20 + c * v21
        c, s, t = _turn(a00, a22, a02, least)
        a00, a22, a02 = a00 - t * a02, a22 + t * a02, 0.0
        a01, a12 = c * a01 - s * a12, s * a01 + c * a12
        v00, v02 = c * v00 - s * v02, s * v00 + c * v02
        v10, v12 = c * v10 - s * v12, s * v10 + c * v12
        v20, v22 = c * v20 - s * v22, s * v20 + c * v22
        c, s, t = _turn(a11, a22, a12, least)
        a11, a22, a12 = a11 - t * a12, a22 + t * a12, 0.0
        a01, a02 = c * a01 - s * a02, s * a01 + c * a02
        v01, v02 = c * v01 - s * v02, s * v01 + c * v02
        v11, v12 = c * v11 - s * v12, s * v11 + c * v12
        v21, v22 = c * v21 - s * v22, s * v21 + c * v22
    if a11 < a00:
        a00, a11, v00, v01, v10, v11, v20, v21 = a11, a00, v01, v00, v11, v10, v21, v20
    if a22 < a11:
        a11, a22, v01, v02, v11, v12, v21, v22 = a22, a11, v02, v01, v12, v11, v22, v21
    if a11 < a00:
        a00, a11, v00, v01, v10, v11, v20, v21 = a11, a00, v01, v00, v11, v10, v21, v20
    values[0], values[1], values[2] = a00, a11, a22
    vectors[0, 0], vectors[0, 1], vectors[0, 2] = v00, v01, v02
    vectors[1, 0], vectors[1, 1], vectors[1, 2] = v10, v11, v12
    vectors[2, 0], vectors[2, 1], vectors[2, 2] = v20, v21, v22


@njit(cache=True, inline="always")
def _turn(app: float, aqq: float, apq: float, least: float) -> tuple[float, float, float]:
    """Return cosine, sine and tangent of the turn that takes the element apq to 0."""
    if abs(apq) <= 1e-4 * least:
        return 1.0, 0.0, 0.0
    theta = (aqq - app) / (2.0 * apq)
    t = 1.0 / (abs(theta) + np.sqrt(theta * theta + 1.0))
    t = t if theta >= 0.0 else -t
    c = 1.0 / np.sqrt(t * t + 1.0)
    return c, t * c, t
