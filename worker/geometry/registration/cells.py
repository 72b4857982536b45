"""The cells of an NDT map: space in bricks of 4 x 4 x 4 cells, a hash table for the bricks, a row a cell."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

REACH = 1 << 20
"""Cells are numbered from -REACH to REACH along each axis."""
CELLS = 64
"""Cells of a brick; cell i, j, k of brick b has the slot 64 b + 16 (i mod 4) + 4 (j mod 4) + k mod 4."""
_SHIFT = 21
_LEAST_SLOTS = 16


def empty_table(bricks: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Return an open-addressed hash table with room for so many bricks: keys, and numbers (-1: free)."""
    slots = max(_LEAST_SLOTS, 1 << int(2 * bricks).bit_length())
    return np.zeros(slots, dtype=np.int64), np.full(slots, -1, dtype=np.int32)


@njit(cache=True, inline="always")
def brick_key(i: int, j: int, k: int) -> int:
    """Return one number that names the brick of a cell."""
    return (((i + REACH) >> 2) << (2 * _SHIFT)) | (((j + REACH) >> 2) << _SHIFT) | ((k + REACH) >> 2)


@njit(cache=True, inline="always")
def place_in_brick(i: int, j: int, k: int) -> int:
    """Return which of a brick's cells a cell is."""
    return ((i & 3) << 4) | ((j & 3) << 2) | (k & 3)


@njit(cache=True)
def cell_at(key: int, place: int) -> tuple[int, int, int]:
    """Return the three numbers of the cell at a place in the brick with a key."""
    i = (key >> (2 * _SHIFT)) * 4 + (place >> 4) - REACH
    j = ((key >> _SHIFT) & ((1 << _SHIFT) - 1)) * 4 + ((place >> 2) & 3) - REACH
    k = (key & ((1 << _SHIFT) - 1)) * 4 + (place & 3) - REACH
    return i, j, k


@njit(cache=True, inline="always")
def find_brick(key: int, table_keys: NDArray[np.int64], table_bricks: NDArray[np.int32]) -> tuple[int, int]:
    """Return a brick's number, -1 if the table lacks it, and where in the table it is or would be."""
    mask = len(table_keys) - 1
    product = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)  # Fibonacci hashing
    slot = int(np.int64((product >> np.uint64(43)) ^ (product >> np.uint64(22)))) & mask
    while table_bricks[slot] >= 0 and table_keys[slot] != key:
        slot = (slot + 1) & mask
    return int(table_bricks[slot]), slot


@njit(cache=True)
def fill_table(
    keys: NDArray[np.int64], table_keys: NDArray[np.int64], table_bricks: NDArray[np.int32]
) -> None:
    """Put every brick into its slot, or the next free one; a brick's number is its place among the keys."""
    for brick in range(len(keys)):
        _, slot = find_brick(keys[brick], table_keys, table_bricks)
        table_keys[slot] = keys[brick]
        table_bricks[slot] = brick


@njit(cache=True)
def neighbour_rows(
    cells: NDArray[np.int32],
    bricks: NDArray[np.int64],
    table_keys: NDArray[np.int64],
    table_bricks: NDArray[np.int32],
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return, for every cell of the bricks, the list of the occupied cells among the 27 around it.

    Parameters
    ----------
    cells : ndarray of shape (C, 3), int32
        The occupied cells; their places here are what the lists hold, ascending.
    bricks : ndarray of shape (B,), int64
        Keys of all bricks that an occupied cell touches.
    table_keys, table_bricks : ndarrays of shape (S,)
        The table of the bricks.

    Returns
    -------
    tuple
        Where each slot's list starts (64 B + 1,), and the lists end to end (L,).
    """
    starts = np.zeros(CELLS * len(bricks) + 1, dtype=np.int32)
    slots = np.zeros(27, dtype=np.int64)
    for c in range(len(cells)):
        _slots_around(cells[c], table_keys, table_bricks, slots)
        for n in range(len(slots)):
            starts[slots[n] + 1] += 1
    for slot in range(CELLS * len(bricks)):
        starts[slot + 1] += starts[slot]
    lists, filled = np.zeros(starts[-1], dtype=np.int32), starts[:-1].copy()
    for c in range(len(cells)):
        _slots_around(cells[c], table_keys, table_bricks, slots)
        for n in range(len(slots)):
            slot = slots[n]
            lists[filled[slot]] = c
            filled[slot] += 1
    return starts, lists


@njit(cache=True)
def _slots_around(
    cell: NDArray[np.int32],
    table_keys: NDArray[np.int64],
    table_bricks: NDArray[np.int32],
    slots: NDArray[np.int64],
) -> None:
    """Write the slots of a cell and the 26 around it."""
    key, brick, n = -1, 0, 0
    for i in range(cell[0] - 1, cell[0] + 2):
        for j in range(cell[1] - 1, cell[1] + 2):
            for k in range(cell[2] - 1, cell[2] + 2):
                other = brick_key(i, j, k)
                if other != key:
                    key, (brick, _) = other, find_brick(other, table_keys, table_bricks)
                slots[n] = CELLS * brick + place_in_brick(i, j, k)
                n += 1


def touched_bricks(cells: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the keys of the bricks in which occupied cells (C, 3) and the 26 around each lie.

    Notes
    -----
    Quickest where cells of one brick follow each other.
    """
    bricks = 1 + int(np.count_nonzero(np.diff(cells >> 2, axis=0).any(axis=1)))
    return _touched_bricks(cells, *empty_table(min(8 * len(cells), 27 * bricks)))


@njit(cache=True)
def _touched_bricks(
    cells: NDArray[np.int32], table_keys: NDArray[np.int64], table_bricks: NDArray[np.int32]
) -> NDArray[np.int64]:
    """Return the keys of the bricks that cells touch; the table given is empty and has room for them."""
    keys, used = np.zeros(len(table_keys), dtype=np.int64), 0
    for c in range(len(cells)):
        i, j, k = int(cells[c, 0]), int(cells[c, 1]), int(cells[c, 2])
        for a in range((i - 1) >> 2, ((i + 1) >> 2) + 1):
            for b in range((j - 1) >> 2, ((j + 1) >> 2) + 1):
                for d in range((k - 1) >> 2, ((k + 1) >> 2) + 1):
                    key = brick_key(4 * a, 4 * b, 4 * d)
                    brick, slot = find_brick(key, table_keys, table_bricks)
                    if brick < 0:
                        table_keys[slot], table_bricks[slot], keys[used] = key, used, key
                        used += 1
    return keys[:used].copy()


@njit(cache=True, inline="always")
def find_row(
    x: float,
    y: float,
    z: float,
    per_metre: float,
    table_keys: NDArray[np.int64],
    table_bricks: NDArray[np.int32],
) -> int:
    """Return the slot of the cell in which a point lies, or -1 if nothing is near it."""
    x, y, z = x * per_metre, y * per_metre, z * per_metre
    if not (abs(x) < REACH and abs(y) < REACH and abs(z) < REACH):
        return -1
    i, j, k = int(np.floor(x)), int(np.floor(y)), int(np.floor(z))
    brick, _ = find_brick(brick_key(i, j, k), table_keys, table_bricks)
    return -1 if brick < 0 else CELLS * brick + place_in_brick(i, j, k)
