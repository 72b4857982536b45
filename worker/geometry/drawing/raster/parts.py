"""The connected parts of the ink, and how large and how solid each is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_LEAST, _MOST = 0.06, 10.0
_HOLLOW = 0.04


@dataclass(frozen=True, eq=False)
class Parts:
    """Hold the P connected parts of the ink, part 0 being the paper.

    Parameters
    ----------
    labels : ndarray of shape (H, W), int32
        The part of each working pixel.
    extent : ndarray of shape (P,)
        Longer side of the bounding box [m].
    long, short : ndarray of shape (P,)
        Sides of the smallest rectangle, turned as it fits, around the part [m].
    area : ndarray of shape (P,)
        Of its ink [m^2].
    box : ndarray of shape (P, 4), int
        Left, top, width and height of the bounding box, in working pixels.
    middle, axis : ndarrays of shape (P, 2)
        Of the smallest rectangle: its middle, and the unit direction of its long side [working px].
    hollow : ndarray of shape (P,), bool
        Whether a part of middle size encloses paper of at least 20 x 20 cm.
    """

    labels: NDArray[np.int32]
    extent: NDArray[np.float64]
    long: NDArray[np.float64]
    short: NDArray[np.float64]
    area: NDArray[np.float64]
    box: NDArray[np.int64]
    middle: NDArray[np.float64]
    axis: NDArray[np.float64]
    hollow: NDArray[np.bool_]

    @property
    def fill(self) -> NDArray[np.float64]:
        """Return the (P,) shares of that smallest rectangle that are ink."""
        return np.asarray(self.area / np.maximum(self.long * self.short, 1e-12), dtype=np.float64)

    def without(self, parts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return the (H, W) ink without the given parts."""
        kept = np.full(len(self.long), fill_value=True)
        kept[parts] = False
        kept[0] = False
        return np.asarray(kept[self.labels], dtype=np.bool_)


def measure_parts(mask: NDArray[np.bool_], metres_per_px: float) -> Parts:
    """Return the sizes of the 8-connected parts, numbered as `find_strokes` numbers them."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    box = stats[:, : cv2.CC_STAT_HEIGHT + 1].astype(np.int64)
    extent = box[:, 2:].max(axis=1) * metres_per_px
    long, short = extent.copy(), extent.copy()
    hollow = np.zeros(len(extent), dtype=bool)
    middle, axis = np.zeros((2, len(extent), 2))
    for part in np.flatnonzero((extent > _LEAST) & (extent < _MOST)):
        x, y, w, h = box[part]
        one = (labels[y : y + h, x : x + w] == part).astype(np.uint8)
        points = cv2.findNonZero(one)
        centre, sides, degrees = cv2.minAreaRect(points)
        turn = np.radians(degrees if sides[0] >= sides[1] else degrees + 90.0)
        middle[part] = centre[0] + x, centre[1] + y
        axis[part] = np.cos(turn), np.sin(turn)
        long[part], short[part] = (np.array(sorted(sides, reverse=True)) + 1) * metres_per_px
        hollow[part] = _encloses(one, _HOLLOW / metres_per_px**2)
    long[0] = short[0] = extent[0] = 0.0
    area = np.asarray(stats[:, cv2.CC_STAT_AREA] * metres_per_px**2, dtype=np.float64)
    area[0] = 0.0
    return Parts(np.asarray(labels, dtype=np.int32), extent, long, short, area, box, middle, axis, hollow)


def _encloses(one: NDArray[np.uint8], least: float) -> bool:
    """Return whether a part encloses paper of at least `least` pixels."""
    if one.size < least:
        return False
    holes, tree = cv2.findContours(one, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    return any(tree[0, k, 3] >= 0 and cv2.contourArea(hole) >= least for k, hole in enumerate(holes))
