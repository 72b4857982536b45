"""A point cloud: positions with a label each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from service.domain.extent import Extent


class Label(IntEnum):
    """What a point belongs to, as the `label` field of PCL's ``PointXYZL``."""

    UNKNOWN = 0
    WALL = 1
    CEILING = 2
    FLOOR = 3
    LAYER = 4


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Hold N points and what each belongs to.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Positions in the frame that the holder names [m].
    labels : ndarray of shape (N,), uint32
        Values of `Label`.

    Raises
    ------
    ValueError
        If the shapes disagree or a position is not finite.
    """

    points: NDArray[np.float64]
    labels: NDArray[np.uint32]

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            msg = f"points are (N, 3), not {self.points.shape}"
            raise ValueError(msg)
        if self.labels.shape != (len(self.points),):
            msg = f"{len(self.points)} points need as many labels, not {self.labels.shape}"
            raise ValueError(msg)
        if not np.isfinite(self.points).all():
            msg = "points are finite"
            raise ValueError(msg)

    @classmethod
    def of(cls, points: NDArray[np.floating], label: Label = Label.UNKNOWN) -> PointCloud:
        """Return a cloud of (N, 3) points that all have one label."""
        return cls(np.asarray(points, dtype=np.float64), np.full(len(points), label, dtype=np.uint32))

    def __len__(self) -> int:
        return len(self.points)


def joined(clouds: Sequence[PointCloud]) -> PointCloud:
    """Return the points of clouds in one frame, one cloud after the other."""
    if not clouds:
        return PointCloud.of(np.zeros((0, 3)))
    return PointCloud(
        np.vstack([cloud.points for cloud in clouds]), np.concatenate([cloud.labels for cloud in clouds])
    )


def extent_of(cloud: PointCloud) -> Extent:
    """Return how far a cloud of a point or more reaches, to a tenth of a millimetre."""
    low, high = (np.round(edge, 4).tolist() for edge in (cloud.points.min(axis=0), cloud.points.max(axis=0)))
    return Extent((low[0], low[1], low[2]), (high[0], high[1], high[2]))
