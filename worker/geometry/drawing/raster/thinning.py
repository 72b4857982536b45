"""Ink to lines one pixel wide, and the branches between their junctions."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_INK, _FIRST, _SECOND = np.uint8(1), np.uint8(2), np.uint8(4)


def _removable() -> NDArray[np.uint8]:
    """Return for each of 256 neighbourhoods whether Zhang and Suen remove its middle: in which half-steps.

    Bit i of the neighbourhood is the i-th neighbour clockwise from the upper one.
    """
    table = np.zeros(256, dtype=np.uint8)
    for code in range(256):
        n = [code >> i & 1 for i in range(8)]
        changes = sum(not n[i] and n[(i + 1) % 8] for i in range(8))
        if not (2 <= sum(n) <= 6 and changes == 1):
            continue
        up, right, down, left = n[0], n[2], n[4], n[6]
        if not (up and right and down) and not (right and down and left):
            table[code] |= _FIRST
        if not (up and right and left) and not (up and down and left):
            table[code] |= _SECOND
    return table


def _simple() -> NDArray[np.bool_]:
    """Return for each of 256 neighbourhoods whether its middle can go: all hang together without it.

    Yokoi's number for 8-connection is 1, and there are two neighbours at least.
    """
    table = np.zeros(256, dtype=np.bool_)
    for code in range(256):
        n = [code >> i & 1 for i in range(8)]
        parts = sum((1 - n[i]) * (1 - (1 - n[i + 1]) * (1 - n[(i + 2) % 8])) for i in (0, 2, 4, 6))
        table[code] = parts == 1 and sum(n) >= 2
    return table


def _stairs() -> NDArray[np.bool_]:
    """Return for each of 256 neighbourhoods whether its middle is the inner corner of a slanted line's step.

    It has two neighbours that share an edge with it, at a right angle, and can go.
    """
    table = _simple()
    for code in range(256):
        beside = [code >> i & 1 for i in (0, 2, 4, 6)]
        turns = sum(beside) == 2 and not (beside[0] and beside[2]) and not (beside[1] and beside[3])
        table[code] &= turns
    return table


_TABLE, _SIMPLE, _STAIRS = _removable(), _simple(), _stairs()


def thin(mask: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the skeleton of a (H, W) mask as an (H + 2, W + 2) image, and its (K,) flat places there.

    The image has a rim of zeros; the places are in rising order.

    Notes
    -----
    Zhang and Suen, "A fast parallel algorithm for thinning digital patterns", CACM 27, 1984. A pixel is
    looked at again only after one of its neighbours went: the cost goes with the ink's outline and its
    thickness, not with the sheet. What goes at once is checked one by one, so that no part vanishes, as small
    squares and slanted double lines do with them. The inner corners that they leave in slanted lines, each
    of which would pass for a junction, are taken out last. One byte a pixel.
    """
    image = np.zeros((mask.shape[0] + 2, mask.shape[1] + 2), dtype=np.uint8)
    image[1:-1, 1:-1] = mask
    flat = image.reshape(-1)
    _thin(flat, image.shape[1], _TABLE, _SIMPLE)
    places = np.flatnonzero(flat)
    _smooth(flat, places, image.shape[1], _STAIRS)
    return image, places[flat[places] > 0]


def branches(
    skeleton: NDArray[np.uint8], places: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the skeleton's pixels as (M, 2) rows and columns in walking order, and where branches start.

    Junction pixels (three neighbours or more) belong to no branch. A closed loop is cut at its first pixel.

    Parameters
    ----------
    skeleton : ndarray of shape (H + 2, W + 2), uint8
        As `thin` gives it; it is used up.
    places : ndarray of shape (K,), int64
        Flat places of its pixels.
    """
    flat, width = skeleton.reshape(-1), skeleton.shape[1]
    order, starts = _walk(flat, places, width)
    rows, columns = np.divmod(order, width)
    return np.column_stack([rows - 1, columns - 1]), starts


@numba.njit(cache=True)
def _steps(width: int) -> NDArray[np.int64]:  # pragma: no cover - compiled
    """Return the eight neighbours' flat offsets, clockwise from the upper one."""
    return np.array([-width, 1 - width, 1, width + 1, width, width - 1, -1, -width - 1])


@numba.njit(cache=True)
def _thin(  # pragma: no cover - compiled
    flat: NDArray[np.uint8], width: int, table: NDArray[np.uint8], simple: NDArray[np.bool_]
) -> None:
    steps = _steps(width)
    waiting = _outline(flat, steps)
    while len(waiting):
        for half in (2, 4):
            gone = np.zeros(len(waiting), dtype=np.int64)
            kept = np.zeros(len(waiting), dtype=np.int64)
            n_gone = n_kept = 0
            for p in waiting:
                if flat[p] & half:
                    flat[p] &= 7 - half
                    if table[_around(flat, steps, p)] & half:
                        gone[n_gone] = p
                        n_gone += 1
                        continue
                if flat[p] & 6:
                    kept[n_kept] = p
                    n_kept += 1
            gone = _removed(flat, steps, gone[:n_gone], simple)
            waiting = _after(flat, steps, gone, kept[:n_kept])


@numba.njit(cache=True)
def _around(flat: NDArray[np.uint8], steps: NDArray[np.int64], p: int) -> int:  # pragma: no cover - compiled
    """Return the neighbourhood of a place as a number: bit i is its i-th neighbour."""
    code = 0
    for i in range(8):
        code |= (flat[p + steps[i]] & 1) << i
    return code


@numba.njit(cache=True)
def _removed(  # pragma: no cover - compiled
    flat: NDArray[np.uint8], steps: NDArray[np.int64], chosen: NDArray[np.int64], simple: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Remove what is chosen, as far as all still hangs together without it; return what went."""
    n = 0
    for p in chosen:
        if simple[_around(flat, steps, p)]:
            flat[p] = 0
            chosen[n] = p
            n += 1
        else:  # a neighbour has gone just now, so that it is looked at again
            flat[p] = 1
    return chosen[:n]


@numba.njit(cache=True)
def _smooth(  # pragma: no cover - compiled
    flat: NDArray[np.uint8], places: NDArray[np.int64], width: int, table: NDArray[np.bool_]
) -> None:
    steps = _steps(width)
    for p in places:
        if table[_around(flat, steps, p)]:
            flat[p] = 0


@numba.njit(cache=True)
def _after(  # pragma: no cover - compiled
    flat: NDArray[np.uint8], steps: NDArray[np.int64], gone: NDArray[np.int64], kept: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return what has to be looked at: what was kept, and the neighbours of what is gone."""
    more = np.zeros(8 * len(gone), dtype=np.int64)
    n = 0
    for p in gone:
        for step in steps:
            q = p + step
            if flat[q] & 1:
                if flat[q] & 6 == 0:
                    more[n] = q
                    n += 1
                flat[q] |= 6
    return np.concatenate((kept, more[:n]))


@numba.njit(cache=True)
def _outline(flat: NDArray[np.uint8], steps: NDArray[np.int64]) -> NDArray[np.int64]:  # pragma: no cover
    """Return the ink pixels that touch paper, marked to be looked at in both half-steps."""
    count = 0
    for p in range(len(flat)):
        if flat[p]:
            count += flat[p + steps[0]] + flat[p + steps[2]] + flat[p + steps[4]] + flat[p + steps[6]] < 4
    found = np.zeros(count, dtype=np.int64)
    n = 0
    for p in range(len(flat)):
        if flat[p]:
            around = 0
            for i in (0, 2, 4, 6):
                around += flat[p + steps[i]] & 1
            if around < 4:
                found[n] = p
                n += 1
    flat[found] = 7
    return found


@numba.njit(cache=True)
def _walk(  # pragma: no cover - compiled
    flat: NDArray[np.uint8], places: NDArray[np.int64], width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return flat places in walking order from each unvisited seed, tips first, and where walks start."""
    steps = np.array([-1, 1, -width, width, -width - 1, -width + 1, width - 1, width + 1])
    n = 0
    junctions = np.zeros(len(places), dtype=np.bool_)
    for k in range(len(places)):
        around = 0
        for step in steps:
            around += flat[places[k] + step]
        junctions[k] = around >= 3
    flat[places[junctions]] = 0
    order = np.zeros(len(places), dtype=np.int64)
    starts = np.zeros(len(places) + 1, dtype=np.int64)
    walks = 0
    for only_tips in (True, False):
        seeds = places[~junctions]
        if only_tips:
            seeds = _tips(flat, seeds, steps)
        for seed in seeds:
            if flat[seed] == 0:
                continue
            starts[walks] = n
            walks += 1
            at = int(seed)
            while at >= 0:
                flat[at] = 0
                order[n] = at
                n += 1
                at = _next(flat, steps, at)
    starts[walks] = n
    return order[:n], starts[: walks + 1]


@numba.njit(cache=True)
def _next(flat: NDArray[np.uint8], steps: NDArray[np.int64], at: int) -> int:  # pragma: no cover - compiled
    """Return the place of the first neighbour that is left, beside before aslant; -1 where there is none."""
    for step in steps:
        if flat[at + step] != 0:
            return int(at + step)
    return -1


@numba.njit(cache=True)
def _tips(  # pragma: no cover - compiled
    flat: NDArray[np.uint8], seeds: NDArray[np.int64], steps: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the seeds with at most one neighbour."""
    found = np.zeros(len(seeds), dtype=np.int64)
    n = 0
    for seed in seeds:
        around = 0
        for step in steps:
            around += flat[seed + step]
        if around <= 1:
            found[n] = seed
            n += 1
    return found[:n]
