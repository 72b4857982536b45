"""Placing a scan as its file gives it: upright, without outliers, its pose told for the file's axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from service.domain.layer_part import OUTLIER
from service.domain.transform import Transform
from worker.geometry.registration.place import Placed, Progress, place_scan
from worker.geometry.registration.target import PlacementTarget
from worker.geometry.scan.upright import UprightScan


def place_upright_scan(
    upright: UprightScan,
    target: PlacementTarget,
    *,
    initial: Transform | None,
    ndt_resolution: float = 1.0,
    progress: Progress | None = None,
) -> Placed:
    """Return where a scan lies on a map, with poses for frame `scan` and labels for all its points.

    Parameters
    ----------
    upright : UprightScan
        The scan and the turn that makes it upright.
    target : PlacementTarget
        The map.
    initial : Transform or None
        Rough pose of the *upright* scan, ``T_map_upright``: a turn about z only means something for what
        stands upright. For a scan that is z up already it is ``T_map_scan``.
    ndt_resolution : float
        As in `place_scan`.
    progress : callable, optional
        As in `place_scan`.

    Returns
    -------
    Placed
        ``T_map_scan`` (also of the candidates) takes what `read_scan` returns to the map; `labels` has a
        value for each of its points, `OUTLIER` for those that were left out.

    Raises
    ------
    PlacementNotComputed
        As `place_scan` does.
    """
    outliers = upright.outliers
    cloud = upright.without_outliers if outliers.any() else upright.cloud
    placed = place_scan(cloud, target, initial=initial, ndt_resolution=ndt_resolution, progress=progress)
    if outliers.any():
        labels = np.full(len(outliers), OUTLIER, dtype=np.uint8)
        labels[~outliers] = placed.labels
        placed = replace(placed, labels=labels)
    turn = upright.frame.T_upright_scan
    if np.array_equal(turn.matrix, np.eye(4)):
        return placed
    candidates = tuple(replace(c, T_map_scan=c.T_map_scan @ turn) for c in placed.candidates)
    return replace(placed, T_map_scan=placed.T_map_scan @ turn, candidates=candidates)
