"""How far a sheet lies askew on the scanner, and its levelled frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

_MOST_DEGREES, _LEAST_DEGREES = 10.0, 0.3
_COARSE_DEGREES, _FINE_DEGREES = 0.25, 0.05
_COARSE_BIN, _FINE_BIN = 4.0, 1.5
_MOST_POINTS = 60_000
_CLEAR, _BETTER = 1.25, 1.05


@dataclass(frozen=True)
class Level:
    """Hold the levelled frame of a sheet: where its points lie on the sheet, pixels' corners counted.

    Parameters
    ----------
    angle : float
        Direction of the sheet's level lines against its x axis [rad], y down.
    rows, columns : int
        Of the levelled sheet, grown so that the whole of it is inside.
    left, top : float
        Where the levelled sheet's upper left corner lies on the sheet [px].
    """

    angle: float
    rows: int
    columns: int
    left: float = 0.0
    top: float = 0.0

    @classmethod
    def of(cls, shape: tuple[int, int], angle: float) -> Level:
        """Return the levelled frame of a sheet of (H, W) pixels whose level lines run at the angle [rad]."""
        if angle == 0.0:
            return cls(0.0, *shape)
        height, width = shape
        cosine, sine = math.cos(angle), math.sin(angle)
        columns = math.ceil(width * cosine + height * abs(sine))
        rows = math.ceil(height * cosine + width * abs(sine))
        left = width / 2 - (cosine * columns - sine * rows) / 2
        top = height / 2 - (sine * columns + cosine * rows) / 2
        return cls(angle, rows, columns, left, top)

    @property
    def is_turned(self) -> bool:
        """Return whether the frame differs from the sheet's own."""
        return self.angle != 0.0

    def to_sheet(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where (N, 2) points of the levelled frame lie on the sheet [px, y down]."""
        if not self.is_turned:
            return xy
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        return np.asarray(xy @ turn.T + (self.left, self.top), dtype=np.float64)

    def levelled(self, sheet: NDArray[np.uint8], *, outside: int | None = None) -> NDArray[np.uint8]:
        """Return an image that covers the whole sheet, of any resolution, in the levelled frame.

        What lies beyond the sheet is `outside`, or as the nearest edge where that is None.
        """
        return self.sampled(sheet, sheet.shape, (self.rows, self.columns), outside=outside)

    def sampled(
        self,
        image: NDArray[np.uint8],
        sheet: tuple[int, ...],
        size: tuple[int, int],
        *,
        outside: int | None = None,
    ) -> NDArray[np.uint8]:
        """Return an image of a (H, W) sheet in the levelled frame, in `size` rows and columns."""
        across, down = self.columns / size[1], self.rows / size[0]
        shrink = np.array([image.shape[1] / sheet[1], image.shape[0] / sheet[0]])
        corner = self.to_sheet(np.array([[0.0, 0.0], [across, 0.0], [0.0, down]])) * shrink
        matrix = np.column_stack([corner[1] - corner[0], corner[2] - corner[0], corner[0]])
        matrix[:, 2] += matrix[:, :2].sum(axis=1) / 2 - 0.5
        border = cv2.BORDER_REPLICATE if outside is None else cv2.BORDER_CONSTANT
        flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
        value = (float(outside or 0),)
        return np.asarray(
            cv2.warpAffine(image, matrix, size[::-1], flags=flags, borderMode=border, borderValue=value),
            dtype=np.uint8,
        )


def find_skew(mask: NDArray[np.bool_]) -> float:
    """Return the direction of the level lines of a (H, W) sheet of ink [rad], 0 where it lies straight.

    Up to 10 degrees are looked for, a third of a degree is the least that counts, and 0 is the answer where
    no direction stands out.

    Notes
    -----
    The ink is projected along each direction and across it; long straight lines gather in few bins, so the
    sum of the squared counts is largest along them (Postl, 1986). Some 60,000 points are enough.
    """
    places = np.flatnonzero(mask)
    if len(places) < 200:
        return 0.0
    places = places[:: max(1, len(places) // _MOST_POINTS)]
    y, x = np.divmod(places, mask.shape[1])
    xy = np.column_stack([x - mask.shape[1] / 2, y - mask.shape[0] / 2])
    coarse = np.arange(-_MOST_DEGREES, _MOST_DEGREES + _COARSE_DEGREES / 2, _COARSE_DEGREES)
    gathered = np.array([_gathered(xy, angle, _COARSE_BIN) for angle in coarse])
    best = int(np.argmax(gathered))
    straight = gathered[np.abs(coarse) < _COARSE_DEGREES * 1.1].max()
    if gathered[best] < _CLEAR * np.median(gathered) or gathered[best] < _BETTER * straight:
        return 0.0
    reach = _COARSE_DEGREES * 1.2
    fine = np.arange(coarse[best] - reach, coarse[best] + reach + _FINE_DEGREES / 2, _FINE_DEGREES)
    sharp = np.array([_gathered(xy, angle, _FINE_BIN) for angle in fine])
    angle = _peak(fine, sharp)
    return math.radians(angle) if abs(angle) >= _LEAST_DEGREES else 0.0


def _gathered(xy: NDArray[np.float64], degrees: float, width: float) -> float:
    """Return how far the points gather in lines along and across a direction: mean of squared counts."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    total = 0.0
    for a, b in ((cosine, sine), (-sine, cosine)):
        bins = np.floor((xy[:, 0] * a + xy[:, 1] * b) / width).astype(np.int64)
        counts = np.bincount(bins - bins.min())
        total += float((counts.astype(np.float64) ** 2).sum())
    return total / len(xy)


def _peak(at: NDArray[np.float64], value: NDArray[np.float64]) -> float:
    """Return where the parabola through the largest value and its neighbours is highest."""
    k = int(np.argmax(value))
    if k in (0, len(at) - 1):
        return float(at[k])
    low, mid, high = value[k - 1 : k + 2]
    bend = low - 2 * mid + high
    return float(at[k] + (0.5 * (low - high) / bend if bend < 0 else 0.0) * (at[1] - at[0]))
