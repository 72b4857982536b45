"""A cloud in levels of detail: an octree whose nodes add up to the cloud, coarse ones first.

Schuetz, "Potree: Rendering Large Point Clouds in Web Browsers" (2016), section 3: every point lies in one
node; a node holds a sample of its cube, 64 cells along an edge, of what the nodes above it have left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_DEEPEST = 20
_CELLS_LEVEL = 6
_LEAF = 12_000
_LEAST_EDGE = 1.0
_SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two zero bits after each of 21 bits."""


@dataclass(frozen=True)
class Node:
    """Hold a node: a cube with edge ``edge / 2**depth`` at `cell` of that depth's grid, and its points.

    Parameters
    ----------
    depth : int
        0 for the root.
    cell : tuple of int
        x, y and z, each from 0 to ``2**depth - 1``.
    begin, count : int
        Its points among the octree's `order`.
    """

    depth: int
    cell: tuple[int, int, int]
    begin: int
    count: int


@dataclass(frozen=True, eq=False)
class Octree:
    """Hold the nodes over N points.

    Parameters
    ----------
    low : ndarray of shape (3,), float64
        Lower corner of the root's cube [m].
    edge : float
        Edge of the root's cube [m].
    order : ndarray of shape (N,), int64
        The points, node after node.
    nodes : tuple of Node
        By depth, then along a Z-order curve; no node without points.
    """

    low: NDArray[np.float64]
    edge: float
    order: NDArray[np.int64]
    nodes: tuple[Node, ...]


def octree(points: NDArray[np.float64]) -> Octree:
    """Return the levels of detail of a cloud; the same points give the same nodes.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        N >= 1 [m].

    Notes
    -----
    Points are sorted once along a Z-order curve. Where a point's code differs from the one before tells the
    coarsest grid in which it is the first of its cell; that grid is the node that takes it. A cube in which
    at most 12,000 points are left takes them all. O(N log N).
    """
    low = points.min(axis=0)
    edge = max(_LEAST_EDGE, float((points.max(axis=0) - low).max()))
    code = _z_order(
        np.minimum((points - low) / edge * (1 << _DEEPEST), (1 << _DEEPEST) - 1).astype(np.uint64)
    )
    order = np.argsort(code, kind="stable")
    code = code[order]
    depth = _depths(code)
    by_depth = np.argsort(depth, kind="stable")
    order, code, depth = order[by_depth], code[by_depth], depth[by_depth]
    prefix = code >> (3 * (_DEEPEST - depth)).astype(np.uint64)
    begins = np.flatnonzero(np.append(True, (np.diff(depth) != 0) | (prefix[1:] != prefix[:-1])))
    counts = np.diff(np.append(begins, len(code)))
    nodes = tuple(
        Node(int(depth[b]), _cell(int(prefix[b]), int(depth[b])), int(b), int(count))
        for b, count in zip(begins, counts, strict=True)
    )
    return Octree(low, edge, order, nodes)


def _depths(code: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the depth of the node that takes each point, of codes in ascending order."""
    level = _first_levels(code)
    depth = np.full(len(code), _DEEPEST - _CELLS_LEVEL, dtype=np.int64)
    left = np.arange(len(code))
    for d in range(_DEEPEST - _CELLS_LEVEL):
        prefix = code[left] >> np.uint64(3 * (_DEEPEST - d))
        begins = np.flatnonzero(np.append(True, prefix[1:] != prefix[:-1]))
        counts = np.diff(np.append(begins, len(left)))
        taken = np.repeat(counts <= _LEAF, counts) | (level[left] <= d + _CELLS_LEVEL)
        depth[left[taken]] = d
        left = left[~taken]
        if not len(left):
            break
    return depth


def _first_levels(code: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return the coarsest level at which each point is the first of its cell; for a twin beyond all."""
    differing = code[1:] ^ code[:-1]
    upper = differing >> np.uint64(30)
    bits = np.where(upper > 0, 30 + _bit_length(upper), _bit_length(differing & np.uint64((1 << 30) - 1)))
    return np.append(0, _DEEPEST + 1 - (bits + 2) // 3)


def _bit_length(values: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Return how many bits each value takes; exact below 2**53."""
    return np.frexp(values.astype(np.float64))[1].astype(np.int64)


def _z_order(index: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the interleaved bits of (N, 3) indices below 2**21: x, y, z from the top of each triple."""
    spread = index.T.copy()
    for shift, mask in _SPREAD:
        spread = (spread | (spread << np.uint64(shift))) & np.uint64(mask)
    return np.asarray((spread[0] << np.uint64(2)) | (spread[1] << np.uint64(1)) | spread[2])


def _cell(prefix: int, depth: int) -> tuple[int, int, int]:
    """Return the cell whose code is `prefix`."""
    x = y = z = 0
    for bit in range(depth):
        triple = prefix >> (3 * bit)
        x |= (triple >> 2 & 1) << bit
        y |= (triple >> 1 & 1) << bit
        z |= (triple & 1) << bit
    return x, y, z
