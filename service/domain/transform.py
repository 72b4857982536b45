"""Rigid transforms between named frames: column vectors, right-handed, metres, radians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Transform:
    """Hold `T_a_b`: the rigid motion that takes coordinates in frame b to coordinates in frame a.

    Parameters
    ----------
    matrix : ndarray of shape (4, 4), float64
        Rotation and translation [m]; the last row is 0 0 0 1.

    Raises
    ------
    ValueError
        If the matrix is not 4x4, not finite, scaled, sheared or mirrored.
    """

    matrix: NDArray[np.float64]

    def __post_init__(self) -> None:
        m = np.array(self.matrix, dtype=np.float64)
        if m.shape != (4, 4):
            msg = f"a transform is a 4x4 matrix, not one of shape {m.shape}"
            raise ValueError(msg)
        if not np.isfinite(m).all():
            msg = "a transform holds finite numbers only"
            raise ValueError(msg)
        if not np.allclose(m[3], [0.0, 0.0, 0.0, 1.0], atol=_TOLERANCE):
            msg = f"the last row of a transform is 0 0 0 1, not {m[3].tolist()}"
            raise ValueError(msg)
        r = m[:3, :3]
        if not np.allclose(r @ r.T, np.eye(3), atol=_TOLERANCE):
            msg = "the rotation of a transform is orthonormal: this one scales or shears"
            raise ValueError(msg)
        if np.linalg.det(r) < 0:
            msg = "a transform turns and moves; this one mirrors"
            raise ValueError(msg)
        m.flags.writeable = False
        object.__setattr__(self, "matrix", m)

    @classmethod
    def identity(cls) -> Self:
        """Return the transform that changes nothing."""
        return cls(np.eye(4))

    @classmethod
    def of(cls, rows: ArrayLike) -> Self:
        """Return the transform of four rows of four numbers.

        Raises
        ------
        ValueError
            As the class: if they are no rigid motion.
        """
        return cls(np.asarray(rows, dtype=np.float64))

    @classmethod
    def from_xyz_yaw(cls, x: float, y: float, z: float, yaw: float) -> Self:
        """Return a translation [m] and a turn about z [rad]."""
        return cls.from_xyz_rpy((x, y, z), (0.0, 0.0, yaw))

    @classmethod
    def from_xyz_rpy(cls, xyz: ArrayLike, rpy: ArrayLike) -> Self:
        """Return the transform ``Rz(yaw) Ry(pitch) Rx(roll)`` with translation `xyz` [m], `rpy` [rad]."""
        roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
        cr, sr, cp, sp, cy, sy = (
            np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw),
        )  # fmt: skip
        m = np.eye(4)
        m[:3, :3] = [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
        m[:3, 3] = np.asarray(xyz, dtype=np.float64)
        return cls(m)

    @property
    def translation(self) -> NDArray[np.float64]:
        """Return the (3,) translation [m]."""
        return self.matrix[:3, 3]

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Return the (3, 3) rotation."""
        return self.matrix[:3, :3]

    @property
    def rpy(self) -> tuple[float, float, float]:
        """Return roll, pitch and yaw [rad], as in `from_xyz_rpy`."""
        r = self.rotation
        pitch = float(np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0])))
        return float(np.arctan2(r[2, 1], r[2, 2])), pitch, float(np.arctan2(r[1, 0], r[0, 0]))

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 3) points given in frame b as points in frame a."""
        return points @ self.rotation.T + self.translation

    def inverse(self) -> Transform:
        """Return `T_b_a`."""
        m = np.eye(4)
        m[:3, :3] = self.rotation.T
        m[:3, 3] = -self.rotation.T @ self.translation
        return Transform(m)

    def __matmul__(self, other: Transform) -> Transform:
        """Return `T_a_c` from this `T_a_b` and `T_b_c`, its rotation made orthonormal again."""
        m = self.matrix @ other.matrix
        u, _, vt = np.linalg.svd(m[:3, :3])
        m[:3, :3] = u @ vt
        return Transform(m)

    def distance_to(self, other: Transform) -> tuple[float, float]:
        """Return how far apart two transforms are: distance of origins [m] and angle of turn [rad]."""
        delta = self.inverse() @ other
        cosine = (np.trace(delta.rotation) - 1.0) / 2.0
        return float(np.linalg.norm(delta.translation)), float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def tolist(self) -> list[list[float]]:
        """Return the matrix as nested lists for JSON."""
        rows: list[list[float]] = self.matrix.tolist()
        return rows
