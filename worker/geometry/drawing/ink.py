"""Grey sheet to ink: darkness against the local paper, at a working resolution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

_FINEST = 0.0125
_DUST = 0.04
_PAPER_CELL = 0.1
_PAPER_WINDOW = 2.6
_LEAST_CONTRAST = 20.0
_SHARE_OF_DARKEST = 0.4


@dataclass(frozen=True, eq=False)
class Ink:
    """Hold what is drawn, at a working resolution of about a centimetre a pixel.

    Parameters
    ----------
    mask : ndarray of shape (H, W), bool
        True where drawn; row 0 is the top of the sheet.
    contrast : ndarray of shape (H, W), uint8
        Mean darkness of the working pixel against the local paper.
    reduction : int
        Pixels of the sheet in one working pixel, along each side.
    metres_per_px : float
        Of a working pixel.
    sheet_height : float
        Height of the whole sheet [m].
    """

    mask: NDArray[np.bool_]
    contrast: NDArray[np.uint8]
    reduction: int
    metres_per_px: float
    sheet_height: float

    def to_drawing(self, px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 2) working pixels (x, y down; whole numbers are centres) in frame `drawing`."""
        xy = (px + 0.5) * self.metres_per_px
        return np.column_stack([xy[:, 0], self.sheet_height - xy[:, 1]])


def find_ink(grey: NDArray[np.uint8], metres_per_px: float) -> Ink:
    """Return the ink of a (H, W) grey sheet.

    The paper's own colour is found locally (what is brightest within 2.6 m, smoothed), so that shade, folds
    and tinted
    paper are not taken for ink. Then the sheet is reduced to about 1 cm a pixel by the darkest pixel of each
    block, so that thin lines survive. Ink is what stands out from the paper by 40 % of the drawing's own dark
    strokes; what stands out by half of that counts where it touches such ink.

    Notes
    -----
    About four bytes a pixel at the peak; 65 Mpx take about a second.
    """
    full = np.asarray(cv2.subtract(_paper(grey, metres_per_px), grey), dtype=np.uint8)
    reduction = max(1, int(_FINEST / metres_per_px + 1e-9))
    contrast = _darkest(full, reduction)
    noise = float(np.median(contrast)) + 6.0 * _spread(contrast)
    floor = min(max(_LEAST_CONTRAST, noise), 90.0)
    dark = contrast[contrast > floor]
    strong = max(floor, _SHARE_OF_DARKEST * float(np.percentile(dark, 75))) if len(dark) else 255.0
    mask = _hysteresis(contrast, low=max(strong / 2, floor), high=strong)
    return Ink(
        mask, _mean(full, reduction), reduction, metres_per_px * reduction, grey.shape[0] * metres_per_px
    )


def drop_dust(ink: Ink) -> tuple[Ink, NDArray[np.float64]]:
    """Return the ink without parts smaller than 4 cm (at least 3 px), and where they lay, (D, 2) [m].

    A speckled scan has hundreds of thousands of them; no letter, dash or wall is that small.
    """
    least = max(3, round(_DUST / ink.metres_per_px))
    _, labels, stats, centres = cv2.connectedComponentsWithStats(ink.mask.astype(np.uint8), connectivity=8)
    dust = stats[:, [cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT]].max(axis=1) < least
    dust[0] = False
    mask = np.asarray(ink.mask & ~dust[labels], dtype=np.bool_)
    return replace(ink, mask=mask), ink.to_drawing(np.asarray(centres[dust], dtype=np.float64))


def _paper(grey: NDArray[np.uint8], metres_per_px: float) -> NDArray[np.uint8]:
    height, width = grey.shape
    cell = min(max(8.0, _PAPER_CELL / metres_per_px), max(8.0, max(grey.shape) / 32))
    small_size = (max(1, round(width / cell)), max(1, round(height / cell)))
    small = cv2.resize(grey, small_size, interpolation=cv2.INTER_AREA)
    window = max(5, round(_PAPER_WINDOW / (metres_per_px * cell))) | 1
    small = cv2.morphologyEx(small, cv2.MORPH_CLOSE, np.ones((window, window), np.uint8))
    small = cv2.blur(small, (max(3, window // 2) | 1,) * 2)
    return np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.uint8)


def _padded(image: NDArray[np.uint8], k: int) -> NDArray[np.uint8]:
    """Return the image grown to the right and below, with bare paper, to whole blocks of k x k."""
    height, width = image.shape
    return np.pad(image, ((0, -height % k), (0, -width % k)))


def _darkest(image: NDArray[np.uint8], k: int) -> NDArray[np.uint8]:
    """Return the largest contrast of each k x k block."""
    if k == 1:
        return image
    padded = _padded(image, k)
    darkest: NDArray[np.uint8] = np.maximum.reduce([padded[i::k, j::k] for i in range(k) for j in range(k)])
    return darkest


def _mean(image: NDArray[np.uint8], k: int) -> NDArray[np.uint8]:
    """Return the mean contrast of each k x k block."""
    padded = _padded(image, k)
    size = (padded.shape[1] // k, padded.shape[0] // k)
    return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _spread(contrast: NDArray[np.uint8]) -> float:
    """Return the standard deviation of the bare paper: from the median absolute deviation, deaf to ink."""
    sample = contrast[:: max(1, contrast.shape[0] // 1000), :: max(1, contrast.shape[1] // 1000)]
    return 1.4826 * float(np.median(np.abs(sample.astype(np.float32) - np.median(sample))))


def _hysteresis(contrast: NDArray[np.uint8], *, low: float, high: float) -> NDArray[np.bool_]:
    weak = (contrast > low).astype(np.uint8)
    count, labels = cv2.connectedComponents(weak, connectivity=8)
    holds = np.zeros(count, dtype=bool)
    holds[labels[contrast > high]] = True
    holds[0] = False
    return np.asarray(holds[labels], dtype=np.bool_)
