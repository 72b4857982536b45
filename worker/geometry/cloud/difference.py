"""What lies in one cloud and not in another: points are the same where all their bytes are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.cloud.point_cloud import PointCloud


@dataclass(frozen=True, eq=False)
class CloudDifference:
    """Hold the points that only one of two clouds has, in the order of that cloud, and how many both have."""

    added: PointCloud
    removed: PointCloud
    kept: int


def cloud_difference(before: PointCloud, after: PointCloud) -> CloudDifference:
    """Return what was added and removed between two clouds, as multisets of points with their labels.

    Parameters
    ----------
    before, after : PointCloud
        In the same frame [m]; compared as float32, as files hold them.
    """
    old, new = _records(before), _records(after)
    values, group = np.unique(np.concatenate([old, new]), return_inverse=True)
    in_old = np.bincount(group[: len(old)], minlength=len(values))
    in_new = np.bincount(group[len(old) :], minlength=len(values))
    both = np.minimum(in_old, in_new)
    return CloudDifference(
        added=_beyond(after, group[len(old) :], both),
        removed=_beyond(before, group[: len(old)], both),
        kept=int(both.sum()),
    )


def _records(cloud: PointCloud) -> NDArray[np.void]:
    """Return each point's bytes as one value that can be sorted."""
    table = np.zeros((len(cloud), 4), dtype="<u4")
    table[:, :3] = np.ascontiguousarray(cloud.points, dtype="<f4").view("<u4")
    table[:, 3] = cloud.labels
    return table.view("V16")[:, 0]


def _beyond(cloud: PointCloud, group: NDArray[np.intp], both: NDArray[np.intp]) -> PointCloud:
    """Return the points that come after the first ``both[group]`` of their value."""
    order = np.argsort(group, kind="stable")
    in_order = group[order]
    first = np.searchsorted(in_order, in_order, side="left")
    rank = np.zeros(len(group), dtype=np.intp)
    rank[order] = np.arange(len(group)) - first
    extra = rank >= both[group]
    return PointCloud(cloud.points[extra], cloud.labels[extra])
