"""The faces of a building seen from above as images: how near is a face that looks this way."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

HEADINGS = 16
CELL = 0.2
_SPREAD = 0.2
_HEADING_REACH = np.deg2rad(25.0)
_BLOCK = 3


@dataclass(frozen=True, eq=False)
class FaceField:
    """Hold one image a heading: 255 on a face that looks about this way, falling off with the distance.

    Parameters
    ----------
    images : ndarray of shape (16, H, W), uint8
        Row 0 is the lowest y; Gaussian of the distance with a spread of 20 cm.
    low : ndarray of shape (2,), float64
        Lower left corner of the first cell, in frame `map` [m].
    """

    images: NDArray[np.uint8]
    low: NDArray[np.float64]


def face_field(feet: NDArray[np.float64], outward: NDArray[np.float64], *, margin: float) -> FaceField:
    """Return the field of faces that are given by samples along them.

    Parameters
    ----------
    feet, outward : ndarrays of shape (M, 2), float64
        Places on faces at most one cell of 20 cm apart [m], and the unit directions in which they look.
    margin : float
        How far the images reach beyond the faces [m].
    """
    low = feet.min(axis=0) - margin
    shape = np.ceil((feet.max(axis=0) + margin - low) / CELL).astype(np.int64) + 1
    cells = np.floor((feet - low) / CELL).astype(np.int64)
    heading = np.arctan2(outward[:, 1], outward[:, 0])
    images = np.zeros((HEADINGS, shape[1], shape[0]), dtype=np.uint8)
    for k in range(HEADINGS):
        turn = heading - 2.0 * np.pi * k / HEADINGS
        near = np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi) <= _HEADING_REACH
        if not near.any():
            continue
        bare = np.full((shape[1], shape[0]), 255, dtype=np.uint8)
        bare[cells[near, 1], cells[near, 0]] = 0
        away = cv2.distanceTransform(bare, cv2.DIST_L2, 5) * CELL
        images[k] = np.round(255.0 * np.exp(-0.5 * (away / _SPREAD) ** 2)).astype(np.uint8)
    return FaceField(images, low)


def correlate(
    field: FaceField,
    xy: NDArray[np.float64],
    outward: NDArray[np.float64],
    *,
    yaws: NDArray[np.float64],
    window: tuple[NDArray[np.float64], NDArray[np.float64]],
    least: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the best poses of each block of 60 cm and each yaw, and how well the structure lies on faces.

    Every whole-cell shift in the window is tried for every yaw: nothing is left out.

    Parameters
    ----------
    field : FaceField
        The faces, with a margin of at least the structure's own reach around the window.
    xy, outward : ndarrays of shape (K, 2), float64
        Upright pieces in frame `scan` [m], and the unit directions in which they look; K <= 256.
    yaws : ndarray of shape (Y,), float64
        Turns to try [rad].
    window : tuple of two ndarrays of shape (2,)
        Lower and upper corner of where the scan's origin may lie, in frame `map` [m].
    least : float
        Share of the highest score below which a pose is left out.

    Returns
    -------
    tuple
        Poses (B, 3): x, y [m] and yaw [rad]; and scores (B,), 1 where every piece lies on a face.
    """
    c, s = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x, y = c * xy[:, 0] - s * xy[:, 1], s * xy[:, 0] + c * xy[:, 1]
    turned = np.arctan2(outward[:, 1], outward[:, 0])[None] + yaws[:, None]
    heading = np.round(turned / (2.0 * np.pi / HEADINGS)).astype(np.int64) % HEADINGS
    first = np.floor((window[0] - field.low) / CELL).astype(np.int64)
    count = np.maximum(np.ceil((window[1] - window[0]) / CELL).astype(np.int64), 1)
    columns = np.round(x / CELL).astype(np.int64) + first[0]
    rows = np.round(y / CELL).astype(np.int64) + first[1]
    best, at = _shift_and_add(field.images, rows, columns, heading, count[1], count[0])
    turn, block = np.nonzero(best >= np.ceil(least * best.max()))
    row, column = np.divmod(at[turn, block], count[0])
    x, y = (np.array([column, row]) + first[:, None] + 0.5) * CELL + field.low[:, None]
    scores = best[turn, block].astype(np.float64) / (255.0 * max(len(xy), 1))
    return np.column_stack([x, y, yaws[turn]]), scores


@njit(cache=True, parallel=True)
def _shift_and_add(
    images: NDArray[np.uint8],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    heading: NDArray[np.int64],
    height: int,
    width: int,
) -> tuple[NDArray[np.uint16], NDArray[np.int64]]:
    """Return for each yaw and block the largest sum of image values over its shifts, and where."""
    high, wide = (height + _BLOCK - 1) // _BLOCK, (width + _BLOCK - 1) // _BLOCK
    best = np.zeros((len(rows), high * wide), dtype=np.uint16)
    at = np.zeros((len(rows), high * wide), dtype=np.int64)
    tall, broad = images.shape[1], images.shape[2]
    for i in prange(len(rows)):
        total = np.zeros((height, width), dtype=np.uint16)
        for k in range(rows.shape[1]):
            image = images[heading[i, k]]
            left = columns[i, k]
            begin, end = max(0, -left), min(width, broad - left)
            if end <= begin:
                continue
            for r in range(max(0, -rows[i, k]), min(height, tall - rows[i, k])):
                line = image[r + rows[i, k], begin + left : end + left]
                out = total[r, begin:end]
                for n in range(end - begin):
                    out[n] += line[n]
        for r in range(height):
            for n in range(width):
                block = (r // _BLOCK) * wide + n // _BLOCK
                if total[r, n] > best[i, block]:
                    best[i, block] = total[r, n]
                    at[i, block] = r * width + n
    return best, at
