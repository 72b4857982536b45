"""How uncertain a placement's pose is: the covariance that the errors of whole surfaces leave in it.

Points are many and their noise averages out; what does not is that every wall stands somewhat off its
drawing, and that a tablet's tracking drifts between one wall and the next. So the unknowns behind the
residuals are an offset and a turn of each surface, and their sizes are taken from the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration.measure import Fit

TILT = (3, 4)
"""The motions that gravity holds: turns about x and y."""

_PRIOR_WEIGHT = 3.0
_PRIOR_OFFSET, _PRIOR_TURN = 0.006, np.deg2rad(0.15)
_TILT = np.deg2rad(1.0)
_UNHELD = 1e-6
_SHORT = 0.5
_NOISE, _ALIKE = 0.003, 10.0
_CALIBRATION = 0.75
"""Without it the 95 % ellipsoid held 98.7 % of the errors of 1,775 accepted placements in generated halls."""
_LEVEL = 0.7
_ON_FACES = (np.deg2rad(2.0), 0.02)
_ON_CLOUD = (np.deg2rad(20.0), 0.5)


@dataclass(frozen=True, eq=False)
class PoseCovariance:
    """Hold how uncertain a pose is.

    Parameters
    ----------
    matrix : ndarray of shape (6, 6), float64
        Of (x, y, z) [m] and a rotation vector [rad], both in frame `map`: the scan's origin is off by the
        first three, its attitude by ``R_found R_true^T = Exp(last three)``. Infinite on the diagonal where
        nothing holds a motion.
    offset_m, turn_rad : float
        One sigma of the surfaces' offsets and turns that it rests on.
    """

    matrix: NDArray[np.float64]
    offset_m: float
    turn_rad: float

    @property
    def position_std(self) -> float:
        """Return the standard deviation of the worst level direction [m]."""
        level = self.matrix[:2, :2]
        return float(np.sqrt(np.linalg.eigvalsh(level)[-1])) if np.isfinite(level).all() else float("inf")

    @property
    def yaw_std(self) -> float:
        """Return the standard deviation of the turn about the vertical [rad]."""
        return float(np.sqrt(self.matrix[5, 5]))


def pose_covariance(
    fit: Fit, *, origin: NDArray[np.float64], sided: bool, held: tuple[int, ...]
) -> PoseCovariance:
    """Return the covariance of the pose of least squares over the inliers of a fit.

    Parameters
    ----------
    fit : Fit
        How the points lie on the surfaces at the pose.
    origin : ndarray of shape (3,)
        The scan's origin in frame `map` [m].
    sided : bool
        Whether the surfaces are exact faces; those of a cloud are told apart less finely.
    held : tuple of int
        Motions (of 0 to 5) that gravity holds within a degree, besides the surfaces.

    Notes
    -----
    With J_k the Jacobians of surface k, A the normal equations, e_k its offset and t_k its turn about its
    own middle, least squares answers ``x = A^-1 sum_k (s_k e_k + u_k t_k)``, where s_k sums J_k and u_k
    weighs it by the place along the surface; the covariance is that of x (the sandwich of White 1980, by
    clusters). The variance of e_k is the sum of the squared mean residuals over its expected value at
    variance 1, shrunk to 6 mm with the weight of three surfaces; that of t_k is found in the same way. The
    points' own noise is added as if ten neighbours always erred alike. All of it is scaled so that the
    ellipsoid of 95 % holds 95 % of measured errors.
    """
    p, n, r = fit.placed[fit.inlier], fit.plane[fit.inlier], fit.distance[fit.inlier]
    if len(p) < 6:
        return PoseCovariance(np.diag(np.full(6, np.inf)), np.inf, np.inf)
    J = np.hstack([n, np.cross(p - origin, n)])
    A = J.T @ J
    prior = np.zeros(6)
    prior[list(held)] = len(p) * (0.02 / _TILT) ** 2 / 100.0
    A_inverse: NDArray[np.float64] = np.linalg.inv(A + np.diag(prior + _UNHELD * len(p))).astype(np.float64)
    surfaces = [_Surface.of(p[k], n[k], r[k], J[k]) for k in _surfaces_of(p, n, r, sided=sided)]
    offset = _sigma([s.offset for s in surfaces], A_inverse, prior=_PRIOR_OFFSET)
    turn = _sigma([s.turn for s in surfaces if s.turn is not None], A_inverse, prior=_PRIOR_TURN)
    half = [offset * s.offset.pull for s in surfaces]
    half += [turn * s.turn.pull for s in surfaces if s.turn is not None]
    spread = A_inverse @ np.array(half).T
    shrunk = A_inverse @ np.diag(np.sqrt(prior))
    tilt = shrunk * (_TILT * np.sqrt(prior))
    noise = _ALIKE * float(np.mean(r**2) + _NOISE**2) * A_inverse
    matrix = _CALIBRATION * (spread @ spread.T + tilt @ tilt.T + noise)
    return PoseCovariance((matrix + matrix.T) / 2.0, offset, turn)


@dataclass(frozen=True, eq=False)
class _Mode:
    """Hold one unknown of a surface: how it pulls at the pose, and how it shows in the residuals.

    `pull` (6,) is its part in the right side of the normal equations at size 1; `shown` its size as the
    residuals tell it, `answer` (6,) how a motion of the pose changes that.
    """

    pull: NDArray[np.float64]
    shown: float
    answer: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Surface:
    """Hold the two unknowns of a surface; a short one and a level one has no turn."""

    offset: _Mode
    turn: _Mode | None

    @classmethod
    def of(
        cls,
        p: NDArray[np.float64],
        n: NDArray[np.float64],
        r: NDArray[np.float64],
        J: NDArray[np.float64],
    ) -> _Surface:
        offset = _Mode(J.sum(axis=0), float(r.mean()), J.mean(axis=0))
        along = n[:, 0] * p[:, 1] - n[:, 1] * p[:, 0]
        along = along - along.mean()
        square = float(along @ along)
        if abs(n[0, 2]) > _LEVEL or square < len(p) * _SHORT**2:
            return cls(offset, None)
        pull = along @ J
        return cls(offset, _Mode(pull, float(along @ r) / square, pull / square))


def _sigma(modes: list[_Mode], A_inverse: NDArray[np.float64], *, prior: float) -> float:
    """Return the standard deviation of unknowns of one kind that their traces in the residuals tell."""
    if not modes:
        return prior
    answer, pull = np.array([m.answer for m in modes]), np.array([m.pull for m in modes])
    left_over = np.eye(len(modes)) - answer @ A_inverse @ pull.T
    shown = sum(m.shown**2 for m in modes)
    freedom = float(np.sum(left_over**2))
    return float(np.sqrt((_PRIOR_WEIGHT * prior**2 + shown) / (_PRIOR_WEIGHT + freedom)))


def _surfaces_of(
    p: NDArray[np.float64], n: NDArray[np.float64], r: NDArray[np.float64], *, sided: bool
) -> list[NDArray[np.intp]]:
    """Return the points of each plane of the map as indices."""
    turn, width = _ON_FACES if sided else _ON_CLOUD
    level = np.abs(n[:, 2]) > _LEVEL
    heading = np.where(level, -1000.0, np.round(np.arctan2(n[:, 1], n[:, 0]) / turn))
    offset = np.round((np.sum(n * (p - p.mean(axis=0)), axis=1) - r) / width)
    _, member = np.unique(np.column_stack([heading, offset]), axis=0, return_inverse=True)
    order = np.argsort(member.ravel(), kind="stable")
    return np.split(order, np.flatnonzero(np.diff(member.ravel()[order])) + 1)
