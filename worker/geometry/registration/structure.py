"""What a scan shows of a building's walls, seen from above: where they stand and which way they look."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_UPRIGHT = 0.3
_LEVEL = 0.9
_FURNITURE = 1.2
_CELL = 0.2
_TALL = 0.4
_MOST_CELLS = 220
_FLOOR_STEP = 0.05
_LEAST_FLOOR_SHARE = 0.015
_LEVEL_STEP = 0.05


@dataclass(frozen=True, eq=False)
class Structure:
    """Hold K upright pieces of a levelled scan, seen from above.

    Parameters
    ----------
    xy : ndarray of shape (K, 2), float64
        In frame `scan` [m].
    outward : ndarray of shape (K, 2), float64
        Unit directions in which the pieces look, towards the tablet.
    viewpoint : ndarray of shape (2,), float64
        Where the tablet was [m].
    """

    xy: NDArray[np.float64]
    outward: NDArray[np.float64]
    viewpoint: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.xy)


def find_viewpoint(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return where the tablet may be taken to have been, (3,) in frame `scan` [m].

    That is the origin, as tablet apps have it, if it lies among the points; else the middle of their extent.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The scan [m].
    """
    low, high = np.percentile(points, 1, axis=0), np.percentile(points, 99, axis=0)
    if np.all((low < 0.0) & (high > 0.0)):
        return np.zeros(3)
    return np.asarray((low + high) / 2.0, dtype=np.float64)


def find_floor(
    points: NDArray[np.float64], normals: NDArray[np.float64], *, viewpoint: NDArray[np.float64]
) -> float | None:
    """Return the height of the floor in frame `scan` [m], or None where the scan shows none.

    The lowest level surface that looks up, lies below the tablet and holds at least 1.5 % of the points.

    Parameters
    ----------
    points, normals : ndarrays of shape (N, 3), float64
        A thinned scan, z up; normals towards the tablet, zero where unknown [m].
    viewpoint : ndarray of shape (3,), float64
        Where the tablet was [m].
    """
    z = points[(normals[:, 2] > _LEVEL) & (points[:, 2] < viewpoint[2] - 0.3), 2]
    if not len(z):
        return None
    level = np.floor(z / _FLOOR_STEP).astype(np.int64)
    counts = np.bincount(level - level.min())
    wide = np.convolve(counts, np.ones(3, dtype=np.int64), mode="same")
    strong = np.flatnonzero(wide >= max(_LEAST_FLOOR_SHARE * len(points), 0.25 * wide.max()))
    if not len(strong):
        return None
    lowest = int(strong[0])
    while lowest + 1 < len(wide) and wide[lowest + 1] > wide[lowest]:
        lowest += 1
    middle = (lowest + level.min() + 0.5) * _FLOOR_STEP
    return float(np.median(z[np.abs(z - middle) < 1.5 * _FLOOR_STEP]))


def level_shift(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    *,
    onto: NDArray[np.float64],
    onto_normals: NDArray[np.float64],
) -> float:
    """Return by how much to raise a cloud so that its level surfaces lie on those of another [m].

    Parameters
    ----------
    points, normals : ndarrays of shape (N, 3), float64
        A thinned cloud, z up; zero normals where it is not flat [m].
    onto, onto_normals : ndarrays of shape (M, 3), float64
        The other one.

    Notes
    -----
    Correlation of the two profiles of level points over height at 5 cm; the square root of the counts, so
    that floor and ceiling weigh about as much as each other.
    """
    profiles = []
    for p, n in ((points, normals), (onto, onto_normals)):
        z = p[np.abs(n[:, 2]) > _LEVEL, 2]
        level = np.floor((z if len(z) else p[:, 2]) / _LEVEL_STEP).astype(np.int64)
        counts = np.bincount(level - level.min()).astype(np.float64)
        profiles.append((np.sqrt(np.convolve(counts, np.ones(3), mode="same")), int(level.min())))
    (own, own_low), (other, other_low) = profiles
    score = np.correlate(other, own, mode="full")
    shift = int(np.argmax(score)) - (len(own) - 1)
    return float((shift + other_low - own_low) * _LEVEL_STEP)


def find_structure(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    *,
    floor: float | None,
    viewpoint: NDArray[np.float64],
) -> Structure:
    """Return the upright pieces of a scan that stand above furniture, at most 220 of them.

    Parameters
    ----------
    points, normals : ndarrays of shape (N, 3), float64
        A thinned scan, z up; normals towards the tablet, zero where unknown [m].
    floor : float or None
        Height of the floor in frame `scan` [m]; unknown, every upright surface counts.
    viewpoint : ndarray of shape (3,), float64
        Where the tablet was [m].

    Notes
    -----
    One piece a cell of 20 cm and quarter turn, where the points of the cell span at least 40 cm of height.
    """
    upright = (np.abs(normals[:, 2]) < _UPRIGHT) & (np.linalg.norm(normals, axis=1) > 0.5)
    if floor is not None and np.count_nonzero(upright & (points[:, 2] > floor + _FURNITURE)) >= 100:
        upright &= points[:, 2] > floor + _FURNITURE
    p, n = points[upright], normals[upright, :2]
    if not len(p):
        return Structure(np.zeros((0, 2)), np.zeros((0, 2)), viewpoint[:2])
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    quarter = np.round(np.arctan2(n[:, 1], n[:, 0]) / (np.pi / 4)).astype(np.int64) % 8
    cell = np.column_stack([np.floor(p[:, :2] / _CELL).astype(np.int64), quarter])
    _, member = np.unique(cell, axis=0, return_inverse=True)
    member = member.ravel()
    count = np.bincount(member)
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, member, p[:, 2])
    np.maximum.at(high, member, p[:, 2])
    sums = np.column_stack([np.bincount(member, weights=w) for w in (p[:, 0], p[:, 1], n[:, 0], n[:, 1])])
    kept = np.flatnonzero((high - low >= _TALL) & (count >= 3))
    kept = kept[:: 1 + (len(kept) - 1) // _MOST_CELLS] if len(kept) else kept
    xy, outward = sums[kept, :2] / count[kept, None], sums[kept, 2:]
    length = np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    return Structure(np.ascontiguousarray(xy), np.ascontiguousarray(outward / length), viewpoint[:2])
