"""Rows of numbers told apart by one number each: which points share a place, and how many places are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)


def row_keys(rows: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return a number for each of (N, D) rows: the same for equal rows, and else another.

    Where voxels are numbered ``(x * ny + y) * nz + z`` one stray point makes the number overflow; these keys
    hold for any extent. They have no order.

    Parameters
    ----------
    rows : ndarray of shape (N, D), int64
        Voxels, or the bits of coordinates.

    Notes
    -----
    SplitMix64 (Steele, Lea and Flood 2014), chained over the columns. Two of a million rows that differ get
    the same key once in 40 million files.
    """
    keys = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        keys += column.astype(np.uint64)
        keys += _GOLDEN
        keys ^= keys >> np.uint64(30)
        keys *= _FIRST
        keys ^= keys >> np.uint64(27)
        keys *= _SECOND
        keys ^= keys >> np.uint64(31)
    return keys


def distinct_places(points: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first of the points at each place, in their order, and each point's place among these.

    Parameters
    ----------
    points : ndarray of shape (N, D), float64
        Points whose coordinates are equal bit by bit (0.0 and -0.0 as well) share a place.
    """
    bits = np.ascontiguousarray(points + 0.0).view(np.int64)
    _, first, place = np.unique(row_keys(bits), return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.zeros(len(order), dtype=np.intp)
    rank[order] = np.arange(len(order))
    return first[order], rank[place]


def smallest_that_fits(count: Callable[[int], int], most: int) -> int:
    """Return the first of the whole numbers k = 0, 1, 2, ... for which ``count(k) <= most``.

    The count may not grow with k. It is asked for O(log k) times.
    """
    low, high = -1, 0
    while count(high) > most:
        low, high = high, 2 * high + 1
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if count(middle) <= most else (middle, high)
    return high
