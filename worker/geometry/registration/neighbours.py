"""The nearest of many points, found in a grid of dense cells: what a placement asks for a million times."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numba import get_num_threads, njit, prange, set_num_threads
from numpy.typing import NDArray

from worker.geometry.registration.symmetric import eigen

_MOST_CELLS = 1 << 22
_FEWEST, _MOST = 4.0, 16.0
_LEAST_CELL, _TRIES = 0.02, 12
_WORTH_THREADS, _CHUNK = 20_000, 512


@dataclass(frozen=True, eq=False)
class NeighbourGrid:
    """Hold M points, sorted by the cell of a grid in which they lie.

    Parameters
    ----------
    points, normals : ndarrays of shape (M, 3), float64
        Cell after cell [m]; normals zero where there are none.
    index : ndarray of shape (M,), int64
        Place of each among the points as they were given.
    starts : ndarray of shape (X Y Z + 1,), int32
        Where the points of each cell begin, z running fastest.
    low : ndarray of shape (3,), float64
        Lower corner of the first cell [m].
    shape : tuple of int
        X, Y and Z.
    cell : float
        Edge of a cell [m].
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    index: NDArray[np.int64]
    starts: NDArray[np.int32]
    low: NDArray[np.float64]
    shape: tuple[int, int, int]
    cell: float

    @classmethod
    def of(
        cls, points: NDArray[np.float64], normals: NDArray[np.float64] | None = None, *, cell: float = 0.2
    ) -> NeighbourGrid:
        """Return the grid of at least one point; its cells are wider than asked for if else too many."""
        low = points.min(axis=0)
        extent = points.max(axis=0) - low
        while np.prod(np.floor(extent / cell) + 1.0) > _MOST_CELLS:
            cell *= 1.25
        x, y, z = (int(n) for n in np.floor(extent / cell) + 1.0)
        points = np.ascontiguousarray(points)
        starts, index = _sorted_by_cell(points, low, 1.0 / cell, (x, y, z))
        looks = np.zeros_like(points) if normals is None else np.ascontiguousarray(normals[index])
        return cls(points[index], looks, index, starts, low, (x, y, z), cell)

    @classmethod
    def with_cells_of_some(cls, points: NDArray[np.float64]) -> NeighbourGrid:
        """Return the grid of at least one point, its cells as wide as holds some four to sixteen points."""
        grid = cls.of(points)
        for _ in range(_TRIES):
            share = len(points) / np.count_nonzero(np.diff(grid.starts))
            if share < _FEWEST and len(points) > _FEWEST:
                wider = cls.of(points, cell=1.6 * grid.cell)
            elif share > _MOST and grid.cell > _LEAST_CELL:
                wider = cls.of(points, cell=grid.cell / 1.6)
            else:
                break
            if wider.cell == grid.cell or np.prod(wider.shape) <= 1:
                break
            grid = wider
        return grid

    def nearest(
        self,
        points: NDArray[np.float64],
        normals: NDArray[np.float64] | None = None,
        *,
        reach: float,
        weight: float = 0.0,
        most: float = np.inf,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the distance to the nearest point of each of N, inf and -1 where none is within reach.

        Parameters
        ----------
        points : ndarray of shape (N, 3), float64
            Where to look from [m].
        normals : ndarray of shape (N, 3), optional
            Compared with those of the grid.
        reach : float
            Only points nearer than this count [m].
        weight : float
            Metres that a difference of 1 between normals adds, as in a space of six dimensions.
        most : float
            Only points nearer than this in that space count [m].

        Returns
        -------
        tuple
            Distances (N,) in that space and indices (N,) into the points as they were given.

        Notes
        -----
        Exact, like a KD-tree. Cells are looked through in rings until none that is left can be nearer.
        """
        looks = np.zeros((1, 3)) if normals is None else np.ascontiguousarray(normals)
        with _threads_for(len(points)):
            distance, found = _nearest(
                np.ascontiguousarray(points), looks, self.points, self.normals, self.starts, self.low,
                self.shape, self.cell, (reach, most, weight if normals is not None else 0.0),
            )  # fmt: skip
        return distance, np.where(found >= 0, self.index[found], -1)

    def spreads(
        self,
        *,
        neighbours: int,
        left_out: NDArray[np.bool_] | None = None,
        looks: NDArray[np.float64] | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return eigenvalues (M, 3), ascending, and vectors (M, 3, 3) of each point's nearest, it included.

        They are those of the sum of squares about the neighbours' mean, in the order of the points as given.

        Parameters
        ----------
        neighbours : int
            How many.
        left_out : ndarray of shape (M, 2), bool, optional
            Points that are none to a point that looks along their normal, and to one that looks against it.
        looks : ndarray of shape (M, 3), optional
            Which way each point looks; needed with `left_out`.

        Notes
        -----
        A point that finds fewer has a spread of those.
        """
        out = np.zeros((1, 2), dtype=np.bool_) if left_out is None else left_out[self.index]
        ways = np.zeros((1, 3)) if looks is None else looks[self.index]
        with _threads_for(len(self.points)):
            values, vectors = _spreads(
                self.points, self.index, self.starts, self.low, self.shape, self.cell,
                min(neighbours, len(self.points)), (self.normals, ways, out),
            )  # fmt: skip
        return values, vectors


@contextmanager
def _threads_for(count: int) -> Iterator[None]:
    """Let compiled loops over few points run on one thread: waking others costs more than it gives."""
    before = get_num_threads()
    if count < _WORTH_THREADS:
        set_num_threads(1)
    try:
        yield
    finally:
        set_num_threads(before)


@njit(cache=True)
def _sorted_by_cell(
    points: NDArray[np.float64], low: NDArray[np.float64], per_metre: float, shape: tuple[int, int, int]
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return where each cell's points begin, and the points' indices cell after cell."""
    cells = np.zeros(len(points), dtype=np.int64)
    starts = np.zeros(shape[0] * shape[1] * shape[2] + 1, dtype=np.int32)
    for n in range(len(points)):
        i = min(int((points[n, 0] - low[0]) * per_metre), shape[0] - 1)
        j = min(int((points[n, 1] - low[1]) * per_metre), shape[1] - 1)
        k = min(int((points[n, 2] - low[2]) * per_metre), shape[2] - 1)
        cells[n] = (i * shape[1] + j) * shape[2] + k
        starts[cells[n] + 1] += 1
    for c in range(len(starts) - 1):
        starts[c + 1] += starts[c]
    filled, index = starts[:-1].copy(), np.zeros(len(points), dtype=np.int64)
    for n in range(len(points)):
        index[filled[cells[n]]] = n
        filled[cells[n]] += 1
    return starts, index


@njit(cache=True, parallel=True)
def _nearest(  # noqa: PLR0913, PLR0917 - compiled code takes plain arrays
    places: NDArray[np.float64],
    looks: NDArray[np.float64],
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    starts: NDArray[np.int32],
    low: NDArray[np.float64],
    shape: tuple[int, int, int],
    cell: float,
    limits: tuple[float, float, float],
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return distance and row of the nearest point; limits are reach, most and weight."""
    distance = np.full(len(places), np.inf)
    rows = np.full(len(places), -1, dtype=np.int64)
    reach, most, weight = limits
    chunks = (len(places) + _CHUNK - 1) // _CHUNK
    for chunk in prange(chunks):
        for n in range(chunk * _CHUNK, min(len(places), (chunk + 1) * _CHUNK)):
            look = looks[n if weight > 0.0 else 0]
            squares = (reach * reach, most * most, weight * weight)
            square, rows[n] = _nearest_of(places[n], look, points, normals, starts, low, shape, cell, squares)
            if rows[n] >= 0:
                distance[n] = np.sqrt(square)
    return distance, rows


@njit(cache=True)
def _nearest_of(  # noqa: C901, PLR0913, PLR0917 - compiled code takes plain arrays
    place: NDArray[np.float64],
    look: NDArray[np.float64],
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    starts: NDArray[np.int32],
    low: NDArray[np.float64],
    shape: tuple[int, int, int],
    cell: float,
    squares: tuple[float, float, float],
) -> tuple[float, int]:
    """Return the squared distance and row of the point nearest to one place; row -1 if none is near."""
    x, y, z, lx, ly, lz = place[0], place[1], place[2], look[0], look[1], look[2]
    ci, cj, ck = _column(x, low[0], cell), _column(y, low[1], cell), _column(z, low[2], cell)
    (reach, best, weight), at, ring = squares, -1, 0
    while True:
        for i in range(max(ci - ring, 0), min(ci + ring, shape[0] - 1) + 1):
            for j in range(max(cj - ring, 0), min(cj + ring, shape[1] - 1) + 1):
                inner = abs(i - ci) < ring and abs(j - cj) < ring
                row = (i * shape[1] + j) * shape[2]
                for side in range(2 if inner else 1):
                    first = ck + ring if side else ck - ring
                    last = ck - ring if inner and not side else ck + ring
                    first, last = max(first, 0), min(last, shape[2] - 1)
                    if first > last:
                        continue
                    for m in range(starts[row + first], starts[row + last + 1]):
                        dx, dy, dz = points[m, 0] - x, points[m, 1] - y, points[m, 2] - z
                        d = dx * dx + dy * dy + dz * dz
                        if d < best and d < reach:
                            if weight > 0.0:
                                nx, ny, nz = normals[m, 0] - lx, normals[m, 1] - ly, normals[m, 2] - lz
                                d += weight * (nx * nx + ny * ny + nz * nz)
                            if d < best:
                                best, at = d, m
        clear = _clear(x, low[0], cell, ci, ring, shape[0])
        clear = min(clear, _clear(y, low[1], cell, cj, ring, shape[1]))
        clear = min(clear, _clear(z, low[2], cell, ck, ring, shape[2]))
        if clear * clear >= min(best, reach):
            return best, at
        ring += 1


@njit(cache=True, inline="always")
def _column(x: float, low: float, cell: float) -> int:
    """Return in which column of cells a place lies, which may be outside."""
    return int(np.floor((x - low) / cell))


@njit(cache=True, inline="always")
def _clear(x: float, low: float, cell: float, column: int, ring: int, count: int) -> float:
    """Return how far away the next cell along an axis is that a ring has not reached; inf without one."""
    before = x - low - (column - ring) * cell if column - ring > 0 else np.inf
    after = (column + ring + 1) * cell - (x - low) if column + ring < count - 1 else np.inf
    return max(min(before, after), 0.0)


@njit(cache=True, parallel=True)
def _spreads(
    points: NDArray[np.float64],
    index: NDArray[np.int64],
    starts: NDArray[np.int32],
    low: NDArray[np.float64],
    shape: tuple[int, int, int],
    cell: float,
    count: int,
    sides: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return eigenvalues and vectors of the spread of each point's nearest.

    Sides are normals, looks and who is left out on which side of a normal; of one row where none is.
    """
    values, vectors = np.zeros((len(points), 3)), np.zeros((len(points), 3, 3))
    for n in prange(len(points)):
        rows, squares = np.full(count, -1, dtype=np.int64), np.full(count, np.inf)
        _neighbours(n, points, starts, low, shape, cell, rows, squares, sides)
        spread = np.zeros(6)
        _spread_of(points, rows, spread)
        eigen(spread, values[index[n]], vectors[index[n]])
    return values, vectors


@njit(cache=True)
def _neighbours(  # noqa: PLR0913, PLR0917 - compiled code takes plain arrays
    n: int,
    points: NDArray[np.float64],
    starts: NDArray[np.int32],
    low: NDArray[np.float64],
    shape: tuple[int, int, int],
    cell: float,
    rows: NDArray[np.int64],
    squares: NDArray[np.float64],
    sides: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]],
) -> None:
    """Write the rows of a point's nearest, and their squared distances, ascending."""
    x, y, z, most = points[n, 0], points[n, 1], points[n, 2], len(rows) - 1
    normals, looks, left_out = sides
    sided = len(looks) == len(points)
    ci = min(int((x - low[0]) / cell), shape[0] - 1)
    cj = min(int((y - low[1]) / cell), shape[1] - 1)
    ck = min(int((z - low[2]) / cell), shape[2] - 1)
    ring = 0
    while True:
        for i in range(max(ci - ring, 0), min(ci + ring, shape[0] - 1) + 1):
            for j in range(max(cj - ring, 0), min(cj + ring, shape[1] - 1) + 1):
                inner = abs(i - ci) < ring and abs(j - cj) < ring
                for k in range(max(ck - ring, 0), min(ck + ring, shape[2] - 1) + 1):
                    if inner and abs(k - ck) < ring:
                        continue
                    c = (i * shape[1] + j) * shape[2] + k
                    for m in range(starts[c], starts[c + 1]):
                        dx, dy, dz = points[m, 0] - x, points[m, 1] - y, points[m, 2] - z
                        d = dx * dx + dy * dy + dz * dz
                        if d < squares[most] and not (sided and _is_left_out(m, n, normals, looks, left_out)):
                            _put(rows, squares, m, d)
        clear = _clear(x, low[0], cell, ci, ring, shape[0])
        clear = min(clear, _clear(y, low[1], cell, cj, ring, shape[1]))
        clear = min(clear, _clear(z, low[2], cell, ck, ring, shape[2]))
        if clear * clear >= squares[most]:
            return
        ring += 1


@njit(cache=True, inline="always")
def _is_left_out(
    m: int, n: int, normals: NDArray[np.float64], looks: NDArray[np.float64], left_out: NDArray[np.bool_]
) -> bool:
    """Return whether a point is none to another, seen from the side to which that one looks."""
    along = normals[m, 0] * looks[n, 0] + normals[m, 1] * looks[n, 1] + normals[m, 2] * looks[n, 2]
    return bool(left_out[m, 0 if along >= 0.0 else 1])


@njit(cache=True)
def _put(rows: NDArray[np.int64], squares: NDArray[np.float64], row: int, square: float) -> None:
    """Put a row among the nearest, which are ascending; the last one goes."""
    at = len(rows) - 1
    while at > 0 and squares[at - 1] > square:
        squares[at], rows[at] = squares[at - 1], rows[at - 1]
        at -= 1
    squares[at], rows[at] = square, row


@njit(cache=True)
def _spread_of(points: NDArray[np.float64], rows: NDArray[np.int64], spread: NDArray[np.float64]) -> None:
    """Write xx, xy, xz, yy, yz, zz of the squares of some points about their mean; rows -1 are none."""
    x, y, z, count = 0.0, 0.0, 0.0, 0
    for m in rows:
        if m >= 0:
            x, y, z, count = x + points[m, 0], y + points[m, 1], z + points[m, 2], count + 1
    if count == 0:
        return
    x, y, z = x / count, y / count, z / count
    for m in rows:
        if m >= 0:
            dx, dy, dz = points[m, 0] - x, points[m, 1] - y, points[m, 2] - z
            spread[0] += dx * dx
            spread[1] += dx * dy
            spread[2] += dx * dz
            spread[3] += dy * dy
            spread[4] += dy * dz
            spread[5] += dz * dz
