"""Small builders that several tests share, each with a known truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from demo.hall import Hall, synthetic_hall
from demo.sheet import KnownLength, drawing_png, known_length
from demo.survey import ply_bytes, scan_of_new_machine
from worker.geometry.lidar.scene import Scene, prism
from worker.geometry.lidar.tablet import TabletScan

__all__ = ["Hall", "a_drawing_png", "a_scan_ply", "synthetic_hall", "wall_prism"]


def a_drawing_png(path: Path, *, seed: int = 1) -> KnownLength:
    """Write the drawing of a synthetic hall and return its known length."""
    hall = synthetic_hall(seed)
    path.write_bytes(drawing_png(hall))
    return known_length(hall)


def a_scan_ply(path: Path, *, seed: int = 1) -> TabletScan:
    """Write the tablet scan of a synthetic hall's new machine and return it with its truth."""
    scan = scan_of_new_machine(synthetic_hall(seed), seed=seed)
    path.write_bytes(ply_bytes(scan.cloud.points))
    return scan


def wall_prism(
    start: ArrayLike,
    end: ArrayLike,
    *,
    thickness: float,
    z_low: float,
    z_high: float,
    name: str,
) -> Scene:
    """Return a straight wall over the centre line from `start` to `end`.

    Parameters
    ----------
    start, end : array of shape (2,)
        Ends of the centre line [m]; the wall stops there with a square end.
    thickness : float
        Distance of its two faces [m].
    z_low, z_high : float
        Heights of its foot and top [m].
    name : str
        Name of the object.

    Raises
    ------
    ValueError
        If the centre line has no length.
    """
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    if not length > 0:
        msg = "the two ends of a wall are the same point"
        raise ValueError(msg)
    along = (b - a) / length
    side = np.array([-along[1], along[0]]) * (thickness / 2)
    return prism([a - side, b - side, b + side, a + side], z_low, z_high, name=name)
