"""A scan's floor and ceiling: the lowest and highest level surfaces, and how far the floor is tilted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.scan.surface_sample import SurfaceSample

_LEVEL = np.cos(np.deg2rad(12.0))
_STRONG = 0.2
_FEWEST = 40
_OUTERMOST = 0.02


@dataclass(frozen=True)
class Levels:
    """Hold where a scan's floor and ceiling are, in the unit of the scan; None where none was seen.

    Parameters
    ----------
    floor, ceiling : float or None
        Their heights.
    tilt : tuple of float
        The mean normal (x, y, z) of floor and ceiling, pointing up; (0, 0, 1) where neither was seen.
    """

    floor: float | None
    ceiling: float | None
    tilt: tuple[float, float, float]

    @property
    def height(self) -> float | None:
        """Return the height of the room; None without floor and ceiling."""
        return None if self.floor is None or self.ceiling is None else self.ceiling - self.floor

    @property
    def tilt_angle(self) -> float:
        """Return the angle between the normal and z [rad]."""
        return float(np.arccos(np.clip(self.tilt[2], -1.0, 1.0)))


def find_levels(sample: SurfaceSample, upright: NDArray[np.float64]) -> Levels:
    """Return floor and ceiling as the outermost strong level surfaces, as seen after a turn.

    Parameters
    ----------
    sample : SurfaceSample
        The scan's surfaces, in the file's axes.
    upright : ndarray of shape (3, 3), float64
        Rotation that takes the file's up axis to z.

    Notes
    -----
    Flat level places are counted by height; a peak is strong with a fifth of the largest one's count. The
    lowest strong peak is the floor if hardly anything lies under it and it lies in the scan's lower half, the
    highest the ceiling likewise. Heights are medians of the places within two voxels of the peak.
    """
    none = Levels(None, None, (0.0, 0.0, 1.0))
    points = sample.points @ upright.T
    normals = sample.normals @ upright.T
    level = sample.flat & (np.abs(normals[:, 2]) > _LEVEL)
    if not sample.enough or int(level.sum()) < _FEWEST:
        return none
    z, step = points[:, 2], 2.0 * sample.voxel_size
    low, high = np.percentile(z, [_OUTERMOST * 100.0, 100.0 - _OUTERMOST * 100.0])
    slots, count = _counted(np.floor((z[level] - z.min()) / step).astype(np.int64))
    strong = slots[count >= max(_STRONG * float(count.max()), _FEWEST)]
    if not len(strong):
        return none
    middle = 0.5 * (low + high)
    ends = [_height_near(z, level, z.min() + (slot + 0.5) * step, step) for slot in (strong[0], strong[-1])]
    floor = ends[0] if ends[0] < middle else None
    ceiling = ends[1] if ends[1] > middle else None
    return Levels(floor, ceiling, _tilt(points, level, [h for h in (floor, ceiling) if h is not None], step))


def _counted(slot: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the slots that hold a value, or lie beside one, and how many values these and theirs hold.

    Slots are not counted through: one stray place would make more of them than memory holds.
    """
    here, count = np.unique(slot, return_counts=True)
    beside = np.unique(np.concatenate([here - 1, here, here + 1]))
    beside = beside[(beside >= here[0]) & (beside <= here[-1])]
    summed = np.append(0, np.cumsum(count))
    low, high = np.searchsorted(here, beside - 1, "left"), np.searchsorted(here, beside + 1, "right")
    return beside, summed[high] - summed[low]


def _height_near(z: NDArray[np.float64], level: NDArray[np.bool_], guess: float, step: float) -> float:
    """Return the median height of the level places near a peak."""
    near = level & (np.abs(z - guess) <= 2.0 * step)
    return float(np.median(z[near])) if near.any() else float(guess)


def _tilt(
    points: NDArray[np.float64], level: NDArray[np.bool_], heights: list[float], step: float
) -> tuple[float, float, float]:
    """Return the mean upward normal of planes through floor and ceiling, fitted twice, by their area."""
    normals = []
    for height in heights:
        here = points[level & (np.abs(points[:, 2] - height) <= 4.0 * step)]
        normal = np.array([0.0, 0.0, 1.0])
        for reach in (4.0 * step, 1.0 * step):
            off = (here - np.median(here, axis=0)) @ normal
            kept = here[np.abs(off) <= reach]
            if len(kept) < _FEWEST:
                break
            _, _, axes = np.linalg.svd(kept - kept.mean(axis=0), full_matrices=False)
            normal = axes[2] * np.sign(axes[2][2] or 1.0)
        normals.append(normal * len(here))
    total = np.sum(normals, axis=0) if normals else np.array([0.0, 0.0, 1.0])
    x, y, z = total / np.linalg.norm(total)
    return float(x), float(y), float(z)
