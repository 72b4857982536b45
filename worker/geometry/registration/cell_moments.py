"""Count, mean and covariance of the points in each cell of a grid, in one pass over the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from worker.geometry.registration.cells import (
    CELLS,
    REACH,
    brick_key,
    cell_at,
    empty_table,
    fill_table,
    find_brick,
    place_in_brick,
)

_BRICKS, _CELLS, _GROWTH = 1024, 8192, 4


@dataclass(frozen=True, eq=False)
class CellMoments:
    """Hold C cells, by brick and place in it.

    Parameters
    ----------
    cells : ndarray of shape (C, 3), int32
        Columns of the grid; the cell 0, 0, 0 begins at the origin.
    counts : ndarray of shape (C,), int64
        Points in each.
    means : ndarray of shape (C, 3), float64
        Mean of the points [m].
    covariances : ndarray of shape (C, 6), float64
        xx, xy, xz, yy, yz, zz over n - 1 [m^2]; 0 of a single point.
    """

    cells: NDArray[np.int32]
    counts: NDArray[np.int64]
    means: NDArray[np.float64]
    covariances: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.cells)


def cell_moments(points: NDArray[np.float64], resolution: float, *, least: int = 1) -> CellMoments:
    """Return the moments of every cell that holds at least so many points.

    Parameters
    ----------
    points : ndarray of shape (M, 3), float64
        Positions [m].
    resolution : float
        Edge of a cell [m]; cells begin at multiples of it.
    least : int
        Fewest points of a cell.

    Raises
    ------
    ValueError
        If a point lies 2^20 - 1 cells or farther from the origin, or is not finite.

    Notes
    -----
    O(M): points are summed about their cell's centre, so that no digit is lost far from the origin. One
    thread; the same order of points gives the same bits.
    """
    bricks, cell_of, sums = _sums_of(np.ascontiguousarray(points, dtype=np.float64), 1.0 / resolution)
    cells, counts, means, covariances = _moments(bricks, np.argsort(bricks), cell_of, sums, resolution, least)
    return CellMoments(cells, counts, means, covariances)


def _sums_of(
    points: NDArray[np.float64], per_metre: float
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float64]]:
    """Return keys of bricks (B,), rows of their cells (B, 64; -1: empty), and sums (C, 10).

    Sums are in edges of a cell, about its centre: n; x, y, z; xx, xy, xz, yy, yz, zz.
    """
    bricks = np.zeros(_BRICKS, dtype=np.int64)
    cell_of = np.full((_BRICKS, CELLS), -1, dtype=np.int32)
    sums = np.zeros((_CELLS, 10))
    done, used = 0, (0, 0)
    while True:
        table_keys, table_bricks = empty_table(len(bricks))
        fill_table(bricks[: used[0]], table_keys, table_bricks)
        done, used = _gather(points, done, per_metre, table_keys, table_bricks, bricks, cell_of, sums, used)
        if done == len(points):
            return bricks[: used[0]], cell_of[: used[0]], sums[: used[1]]
        if used[0] == len(bricks):
            bricks = np.resize(bricks, _GROWTH * len(bricks))
            room = np.full(((_GROWTH - 1) * len(cell_of), CELLS), -1, dtype=np.int32)
            cell_of = np.vstack([cell_of, room])
        elif used[1] == len(sums):
            sums = np.vstack([sums, np.zeros(((_GROWTH - 1) * len(sums), 10))])
        else:
            msg = f"points reach farther than {REACH - 2} cells of {1.0 / per_metre} m from the origin"
            raise ValueError(msg)


@njit(cache=True)
def _gather(  # noqa: C901, PLR0913, PLR0917 - one loop: calls with arrays double its time
    points: NDArray[np.float64],
    begin: int,
    per_metre: float,
    table_keys: NDArray[np.int64],
    table_bricks: NDArray[np.int32],
    bricks: NDArray[np.int64],
    cell_of: NDArray[np.int32],
    sums: NDArray[np.float64],
    used: tuple[int, int],
) -> tuple[int, tuple[int, int]]:
    """Add points to their cells until all are done or there is no room; return points done, room used.

    Sums run in registers as long as points stay in one cell.
    """
    last_i, last_j, last_k, last_key, brick, row = np.inf, np.inf, np.inf, -1, -1, -1
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = s9 = 0.0
    (used_bricks, used_cells), done = used, len(points)
    for n in range(begin, len(points)):
        x, y, z = points[n, 0] * per_metre, points[n, 1] * per_metre, points[n, 2] * per_metre
        i, j, k = np.floor(x), np.floor(y), np.floor(z)
        if i != last_i or j != last_j or k != last_k:
            if row >= 0:
                _flush(sums, row, s0, s1, s2, s3, s4, s5, s6, s7, s8, s9)
                row = -1
            if not (abs(x) < REACH - 1 and abs(y) < REACH - 1 and abs(z) < REACH - 1):
                done = n
                break
            key = brick_key(int(i), int(j), int(k))
            if key != last_key:
                brick, slot = find_brick(key, table_keys, table_bricks)
                if brick < 0:
                    if used_bricks == len(bricks):
                        done = n
                        break
                    brick = used_bricks
                    table_keys[slot], table_bricks[slot], bricks[brick] = key, brick, key
                    used_bricks += 1
                last_key = key
            place = place_in_brick(int(i), int(j), int(k))
            row = int(cell_of[brick, place])
            if row < 0:
                if used_cells == len(sums):
                    done = n
                    break
                cell_of[brick, place] = row = used_cells
                used_cells += 1
            last_i, last_j, last_k = i, j, k
            s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = s8 = s9 = 0.0
        dx, dy, dz = x - i - 0.5, y - j - 0.5, z - k - 0.5
        s0, s1, s2, s3 = s0 + 1.0, s1 + dx, s2 + dy, s3 + dz
        s4, s5, s6 = s4 + dx * dx, s5 + dx * dy, s6 + dx * dz
        s7, s8, s9 = s7 + dy * dy, s8 + dy * dz, s9 + dz * dz
    if row >= 0:
        _flush(sums, row, s0, s1, s2, s3, s4, s5, s6, s7, s8, s9)
    return done, (used_bricks, used_cells)


@njit(cache=True, inline="always")
def _flush(  # noqa: PLR0913, PLR0917 - compiled code takes plain arrays
    sums: NDArray[np.float64],
    row: int,
    s0: float,
    s1: float,
    s2: float,
    s3: float,
    s4: float,
    s5: float,
    s6: float,
    s7: float,
    s8: float,
    s9: float,
) -> None:
    """Add the sums of a run of points to those of their cell."""
    sums[row, 0] += s0
    sums[row, 1] += s1
    sums[row, 2] += s2
    sums[row, 3] += s3
    sums[row, 4] += s4
    sums[row, 5] += s5
    sums[row, 6] += s6
    sums[row, 7] += s7
    sums[row, 8] += s8
    sums[row, 9] += s9


@njit(cache=True)
def _moments(
    bricks: NDArray[np.int64],
    order: NDArray[np.int64],
    cell_of: NDArray[np.int32],
    sums: NDArray[np.float64],
    resolution: float,
    least: int,
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Return cells, counts, means and covariances, brick after brick."""
    kept = int(np.sum(sums[:, 0] >= least))
    cells, counts = np.zeros((kept, 3), dtype=np.int32), np.zeros(kept, dtype=np.int64)
    means, covariances = np.zeros((kept, 3)), np.zeros((kept, 6))
    c, square = 0, resolution * resolution
    for brick in order:
        for place in range(CELLS):
            row = cell_of[brick, place]
            if row < 0 or sums[row, 0] < least:
                continue
            n = sums[row, 0]
            x, y, z = sums[row, 1] / n, sums[row, 2] / n, sums[row, 3] / n
            i, j, k = cell_at(bricks[brick], place)
            cells[c, 0], cells[c, 1], cells[c, 2], counts[c] = i, j, k, int(n)
            means[c, 0], means[c, 1] = (i + 0.5 + x) * resolution, (j + 0.5 + y) * resolution
            means[c, 2] = (k + 0.5 + z) * resolution
            over = square / max(n - 1.0, 1.0)
            covariances[c, 0] = (sums[row, 4] - n * x * x) * over
            covariances[c, 1] = (sums[row, 5] - n * x * y) * over
            covariances[c, 2] = (sums[row, 6] - n * x * z) * over
            covariances[c, 3] = (sums[row, 7] - n * y * y) * over
            covariances[c, 4] = (sums[row, 8] - n * y * z) * over
            covariances[c, 5] = (sums[row, 9] - n * z * z) * over
            c += 1
    return cells, counts, means, covariances
