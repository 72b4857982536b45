"""A mask with little in it, squeezed: what is small is measured as fast as it is small."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_ROOM = 4


@dataclass(frozen=True, eq=False)
class Squeezed:
    """Hold a mask without the rows and columns that are empty and more than 4 px from what is drawn.

    Parts keep their shape, and those that are more than 8 px apart stay so: thinning, labels, distances to
    the paper and the joining of near ends give what they give on the whole mask.

    Parameters
    ----------
    mask : ndarray of shape (h, w), bool
        What is left.
    rows, columns : ndarrays of shape (h,) and (w,)
        Where its rows and columns lie in the whole mask.
    """

    mask: NDArray[np.bool_]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]

    @classmethod
    def of(cls, mask: NDArray[np.bool_]) -> Squeezed:
        """Return the (H, W) mask squeezed."""
        rows, columns = (_near(np.asarray(mask.any(axis=axis))) for axis in (1, 0))
        return cls(np.ascontiguousarray(mask[np.ix_(rows, columns)]), rows, columns)

    def taken(self, pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return what (H, W) pixels have in its place, (h, w)."""
        return np.ascontiguousarray(pixels[np.ix_(self.rows, self.columns)])

    def in_whole(self, px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 2) places x, y on it as places on the whole mask."""
        x = np.interp(px[..., 0], np.arange(len(self.columns)), self.columns)
        y = np.interp(px[..., 1], np.arange(len(self.rows)), self.rows)
        return np.stack([x, y], axis=-1)


def _near(used: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return which of a row's places are used or near one that is; one at least."""
    wide = cv2.dilate(used.astype(np.uint8)[None], np.ones((1, 2 * _ROOM + 1), np.uint8))[0]
    near = np.flatnonzero(wide)
    return near if len(near) else np.zeros(1, dtype=np.intp)
