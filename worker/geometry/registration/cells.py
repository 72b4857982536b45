"""Keys of the cells of an NDT map, and the hash table that finds a point's neighbours in one look."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

REACH = 1 << 20
"""Cells are numbered from -REACH to REACH along each axis."""
_SHIFT = 21
_AROUND = np.array([(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], dtype=np.int64)


def neighbour_rows(
    keys: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int32]]:
    """Return, for every cell that touches an occupied one, the list of the occupied cells around it.

    Parameters
    ----------
    keys : ndarray of shape (C,), int64
        Keys of the occupied cells, ascending; their places in it are what the lists hold.

    Returns
    -------
    tuple
        Keys of the K cells with a list (ascending), start of each list (K + 1,), lists end to end (L,).
    """
    offsets = (_AROUND[:, 0] << (2 * _SHIFT)) + (_AROUND[:, 1] << _SHIFT) + _AROUND[:, 2]
    touched = (keys[:, None] + offsets[None, :]).ravel()
    cells = np.repeat(np.arange(len(keys), dtype=np.int32), len(offsets))
    order = np.argsort(touched, kind="stable")
    row_keys, starts = np.unique(touched[order], return_index=True)
    return row_keys, np.append(starts, len(touched)).astype(np.int64), cells[order]


def key_table(keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return an open-addressed hash table: key and row of each slot, row -1 where the slot is free.

    Parameters
    ----------
    keys : ndarray of shape (K,), int64
        Distinct keys; the row of a key is its place here.
    """
    slots = 1 << max(4, int(2 * len(keys)).bit_length())
    table_keys = np.full(slots, -1, dtype=np.int64)
    table_rows = np.full(slots, -1, dtype=np.int64)
    fill_table(keys, table_keys, table_rows)
    return table_keys, table_rows


@njit(cache=True, inline="always")
def cell_key(i: np.int64, j: np.int64, k: np.int64) -> np.int64:
    """Return one number that names a cell by its three."""
    return ((i + REACH) << (2 * _SHIFT)) | ((j + REACH) << _SHIFT) | (k + REACH)


@njit(cache=True, inline="always")
def slot_of(key: np.int64, mask: int) -> np.int64:
    """Return where the search for a key begins (Fibonacci hashing)."""
    product = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((product >> np.uint64(24)) & np.uint64(mask))


@njit(cache=True)
def fill_table(keys: NDArray[np.int64], table_keys: NDArray[np.int64], table_rows: NDArray[np.int64]) -> None:
    """Put every key into its slot, or the next free one."""
    mask = len(table_keys) - 1
    for row in range(len(keys)):
        slot = slot_of(keys[row], mask)
        while table_rows[slot] >= 0:
            slot = (slot + 1) & mask
        table_keys[slot] = keys[row]
        table_rows[slot] = row


@njit(cache=True)
def find_row(
    x: float,
    y: float,
    z: float,
    resolution: float,
    table_keys: NDArray[np.int64],
    table_rows: NDArray[np.int64],
) -> np.int64:
    """Return the row of the cell in which a point lies, or -1 if nothing is near it."""
    i = np.int64(np.floor(x / resolution)) + REACH
    j = np.int64(np.floor(y / resolution)) + REACH
    k = np.int64(np.floor(z / resolution)) + REACH
    top = 2 * REACH
    if i < 0 or j < 0 or k < 0 or i >= top or j >= top or k >= top:
        return np.int64(-1)
    key = (i << (2 * _SHIFT)) | (j << _SHIFT) | k
    mask = len(table_keys) - 1
    slot = slot_of(key, mask)
    while table_rows[slot] >= 0:
        if table_keys[slot] == key:
            row: np.int64 = table_rows[slot]
            return row
        slot = (slot + 1) & mask
    return np.int64(-1)
