"""Count, mean and covariance of the points in each cell of a grid, in one pass over the points."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from worker.geometry.registration.cells import REACH, cell_key, fill_table, slot_of

_SLOTS = 1 << 12


def cell_moments(
    points: NDArray[np.float64], resolution: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return key, count, mean and covariance of every cell that holds a point, by ascending key.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        Positions [m].
    resolution : float
        Edge of a cell [m]; cells begin at multiples of it.

    Returns
    -------
    tuple
        Keys (C,), counts (C,), means (C, 3) [m], covariances (C, 3, 3) over n - 1 [m^2]; 0 of a single point.

    Raises
    ------
    ValueError
        If a point lies 2^20 - 1 cells or farther from the origin, or is not finite.

    Notes
    -----
    O(M): points are summed about their cell's centre, so that no digit is lost far from the origin. The cells
    are found by a hash table that grows with them. One thread; the same order of points gives the same bits.
    """
    if len(points) and not (np.abs(points).max() / resolution < REACH - 1):
        msg = f"points reach farther than {REACH - 2} cells of {resolution} m from the origin"
        raise ValueError(msg)
    table_keys = np.full(_SLOTS, -1, dtype=np.int64)
    table_rows = np.full(_SLOTS, -1, dtype=np.int64)
    keys, sums = np.zeros(_SLOTS // 2, dtype=np.int64), np.zeros((_SLOTS // 2, 10))
    used = begin = 0
    points = np.ascontiguousarray(points)
    while begin < len(points):
        used, begin = _gather(points, begin, resolution, table_keys, table_rows, keys, sums, used)
        if begin < len(points):
            table_keys, table_rows, keys, sums = _grown(table_keys, keys, sums, used)
    order = np.argsort(keys[:used])
    return _moments(keys[:used][order], sums[:used][order], resolution)


def _grown(
    table_keys: NDArray[np.int64], keys: NDArray[np.int64], sums: NDArray[np.float64], used: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return table and sums with four times the room."""
    slots = 4 * len(table_keys)
    bigger_keys, bigger_rows = np.full(slots, -1, dtype=np.int64), np.full(slots, -1, dtype=np.int64)
    fill_table(keys[:used], bigger_keys, bigger_rows)
    more_keys, more_sums = np.zeros(slots // 2, dtype=np.int64), np.zeros((slots // 2, 10))
    more_keys[:used], more_sums[:used] = keys[:used], sums[:used]
    return bigger_keys, bigger_rows, more_keys, more_sums


def _moments(
    keys: NDArray[np.int64], sums: NDArray[np.float64], resolution: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    n = sums[:, :1]
    offset = sums[:, 1:4] / n
    cell = np.stack([keys >> 42, (keys >> 21) & (2 * REACH - 1), keys & (2 * REACH - 1)], axis=1) - REACH
    means = (cell + 0.5) * resolution + offset
    packed = (sums[:, 4:] - n * offset[:, [0, 0, 0, 1, 1, 2]] * offset[:, [0, 1, 2, 1, 2, 2]]) / np.maximum(
        n - 1.0, 1.0
    )
    covariances = packed[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    return keys, sums[:, 0].astype(np.int64), means, covariances


@njit(cache=True)
def _gather(
    points: NDArray[np.float64],
    begin: int,
    resolution: float,
    table_keys: NDArray[np.int64],
    table_rows: NDArray[np.int64],
    keys: NDArray[np.int64],
    sums: NDArray[np.float64],
    used: int,
) -> tuple[int, int]:
    """Add points to their cells until all are done or the table is full; return cells and points done."""
    mask = len(table_keys) - 1
    last_key, row = np.int64(-1), 0
    for n in range(begin, len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        i, j, k = np.floor(x / resolution), np.floor(y / resolution), np.floor(z / resolution)
        key = cell_key(np.int64(i), np.int64(j), np.int64(k))
        if key != last_key:
            slot = slot_of(key, mask)
            while table_rows[slot] >= 0 and table_keys[slot] != key:
                slot = (slot + 1) & mask
            row = int(table_rows[slot])
            if row < 0:
                if used == len(keys):
                    return used, n
                table_keys[slot], table_rows[slot], keys[used] = key, used, key
                row = used
                used += 1
            last_key = key
        dx, dy, dz = x - (i + 0.5) * resolution, y - (j + 0.5) * resolution, z - (k + 0.5) * resolution
        sums[row, 0] += 1.0
        sums[row, 1] += dx
        sums[row, 2] += dy
        sums[row, 3] += dz
        sums[row, 4] += dx * dx
        sums[row, 5] += dx * dy
        sums[row, 6] += dx * dz
        sums[row, 7] += dy * dy
        sums[row, 8] += dy * dz
        sums[row, 9] += dz * dz
    return used, len(points)
