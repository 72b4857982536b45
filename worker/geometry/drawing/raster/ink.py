"""Grey sheet to ink: darkness against the local paper, levelled, at a working resolution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.raster.skew import Level, find_skew
from worker.geometry.drawing.raster.speckle import is_blurred, is_speckled, mended, sharpened, without_specks

_FINEST = 0.0125
_DUST = 0.04
_PAPER_CELL = 0.1
_PAPER_WINDOW = 2.6
_LEAST_CONTRAST = 20.0
_SHARE_OF_DARKEST = 0.4
_DARKEST_PAPER = 40
_FRINGE, _GOES_ON = 0.55, 0.6
_LARGEST_TURNED = 27_000
_STRIP_ROWS = 256


def _opposite(dy: int, dx: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return two windows: the neighbour in a direction, and the two in the opposite one."""
    ahead, behind = np.zeros((3, 3), dtype=np.uint8), np.zeros((5, 5), dtype=np.uint8)
    ahead[1 + dy, 1 + dx] = behind[2 - dy, 2 - dx] = behind[2 - 2 * dy, 2 - 2 * dx] = 1
    return ahead, behind


_OPPOSITE = [_opposite(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]


@dataclass(frozen=True, eq=False)
class Ink:
    """Hold what is drawn, at a working resolution of about a centimetre a pixel.

    Parameters
    ----------
    mask : ndarray of shape (H, W), bool
        True where drawn; row 0 is the top of the sheet.
    contrast : ndarray of shape (H, W), uint8
        Mean share of the local paper's light that the working pixel takes away, 255 for all of it.
    reduction : int
        Pixels of the sheet in one working pixel, along each side.
    metres_per_px : float
        Of a working pixel.
    sheet_height : float
        Height of the whole sheet [m].
    level : Level, optional
        The levelled frame that the working pixels lie in, where the sheet lies askew.
    """

    mask: NDArray[np.bool_]
    contrast: NDArray[np.uint8]
    reduction: int
    metres_per_px: float
    sheet_height: float
    level: Level | None = None

    def to_drawing(self, px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 2) working pixels (x, y down; whole numbers are centres) in frame `drawing`.

        That is the sheet as it was uploaded, however askew it lies.
        """
        xy = (px + 0.5) * self.reduction
        on_sheet = (xy if self.level is None else self.level.to_sheet(xy)) * (
            self.metres_per_px / self.reduction
        )
        return np.column_stack([on_sheet[:, 0], self.sheet_height - on_sheet[:, 1]])


def find_ink(grey: NDArray[np.uint8], metres_per_px: float) -> Ink:
    """Return the ink of a (H, W) grey sheet, levelled.

    The paper's own colour is found locally (what is brightest within 2.6 m, smoothed), and ink is measured
    as the share of that light which it takes away, so that shade, folds and tinted paper neither pass for
    ink nor weaken it. A speckled sheet loses its specks, it and a blurred one the slopes beside their lines;
    where specks were blurred as well, lines are mended. One that lies askew is levelled. Then it is reduced
    to about 1 cm a pixel by the darkest pixel of each block, so that thin lines survive. Ink is what stands
    out from the paper by 40 % of the drawing's own dark strokes; what stands out by half of that counts where
    it touches such ink.

    Notes
    -----
    One byte a pixel beside the sheet for a clean one, two where it is speckled or askew.
    """
    reduction = max(1, int(_FINEST / metres_per_px + 1e-9))
    paper = _paper(grey, metres_per_px)
    speckled = is_speckled(grey)
    sheet = without_specks(grey, fill=reduction == 1) if speckled else grey
    level = Level.of((grey.shape[0], grey.shape[1]), 0.0)
    darkest, mean = _reduced(sheet, reduction)
    contrast = _taken(darkest, _paper_at(paper, level, grey.shape, darkest.shape, reduction))
    blurred = is_blurred(contrast)
    contrast = _focused(contrast) if blurred else contrast
    mask = _drawn(contrast, speckled=speckled, blurred=blurred)
    angle = find_skew(mask) if max(grey.shape) <= _LARGEST_TURNED else 0.0
    if angle:
        level = Level.of((grey.shape[0], grey.shape[1]), angle)
        darkest, mean = _reduced(level.levelled(sheet, outside=255), reduction)
        contrast = _taken(darkest, _paper_at(paper, level, grey.shape, darkest.shape, reduction))
        contrast = _focused(contrast) if blurred or reduction == 1 else contrast
        mask = _drawn(contrast, speckled=speckled, blurred=blurred)
    if reduction == 1:
        mean = contrast
    else:
        mean = _taken(mean, _paper_at(paper, level, grey.shape, mean.shape, reduction))
    height = grey.shape[0] * metres_per_px
    return Ink(mask, mean, reduction, metres_per_px * reduction, height, level if angle else None)


def _focused(contrast: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the contrast without blur, and without the specks that come to light."""
    sharp = sharpened(contrast)
    paper = np.asarray(cv2.bitwise_not(sharp), dtype=np.uint8)
    if not is_speckled(paper):
        return sharp
    clean = np.asarray(cv2.bitwise_not(without_specks(paper, fill=False)), dtype=np.uint8)
    return mended(clean)


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
    """Return the colour of the bare paper, in cells of some 10 cm."""
    height, width = grey.shape
    cell = min(max(8.0, _PAPER_CELL / metres_per_px), max(8.0, max(grey.shape) / 32))
    small_size = (max(1, round(width / cell)), max(1, round(height / cell)))
    small = cv2.resize(grey, small_size, interpolation=cv2.INTER_AREA)
    window = max(5, round(_PAPER_WINDOW / (metres_per_px * cell))) | 1
    small = cv2.morphologyEx(small, cv2.MORPH_CLOSE, np.ones((window, window), np.uint8))
    return np.asarray(cv2.blur(small, (max(3, window // 2) | 1,) * 2), dtype=np.uint8)


def _paper_at(
    paper: NDArray[np.uint8], level: Level, sheet: tuple[int, ...], size: tuple[int, ...], reduction: int
) -> NDArray[np.uint8]:
    """Return the paper at the working pixels; the last blocks may reach beyond the sheet."""
    if not level.is_turned:
        return np.asarray(
            cv2.resize(paper, (size[1], size[0]), interpolation=cv2.INTER_LINEAR), dtype=np.uint8
        )
    whole = replace(level, rows=size[0] * reduction, columns=size[1] * reduction)
    return whole.sampled(paper, sheet, (size[0], size[1]))


def _taken(grey: NDArray[np.uint8], paper: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the share of the paper's light that is missing, 255 for all of it."""
    left = cv2.divide(grey, cv2.max(paper, np.full_like(paper, _DARKEST_PAPER)), scale=255.0)
    return np.asarray(cv2.bitwise_not(left), dtype=np.uint8)


def _reduced(sheet: NDArray[np.uint8], k: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return the darkest and the mean grey of each k x k block, in strips; the last blocks may be smaller."""
    if k == 1:
        return sheet, sheet
    height, width = sheet.shape
    rows, columns = -(-height // k), -(-width // k)
    darkest = np.zeros((rows, columns), dtype=np.uint8)
    mean = np.zeros((rows, columns), dtype=np.uint8)
    for top in range(0, rows, _STRIP_ROWS):
        bottom = min(rows, top + _STRIP_ROWS)
        strip = sheet[top * k : bottom * k]
        beyond = ((0, (bottom - top) * k - strip.shape[0]), (0, columns * k - width))
        strip = np.pad(strip, beyond, mode="edge") if any(b for _, b in beyond) else strip
        narrow = np.minimum.reduce([strip[i::k] for i in range(k)])
        darkest[top:bottom] = np.minimum.reduce([narrow[:, j::k] for j in range(k)])
        mean[top:bottom] = cv2.resize(strip, (columns, bottom - top), interpolation=cv2.INTER_AREA)
    return darkest, mean


def _drawn(contrast: NDArray[np.uint8], *, speckled: bool, blurred: bool) -> NDArray[np.bool_]:
    """Return what stands out from the paper; on a soft sheet, without the slopes beside it."""
    noise = float(np.median(contrast[::3, ::3])) + 6.0 * _spread(contrast)
    floor = min(max(_LEAST_CONTRAST, noise), 90.0)
    counts = cv2.calcHist([contrast], [0], None, [256], [0, 256]).ravel()
    counts[: int(floor) + 1] = 0.0
    if not counts.any():
        return np.zeros(contrast.shape, dtype=np.bool_)
    high = float(np.searchsorted(np.cumsum(counts), 0.75 * counts.sum()))
    strong = max(floor, _SHARE_OF_DARKEST * high)
    sharp = contrast
    if speckled or blurred:
        slope = _slopes(contrast)
        sharp = np.where(slope & ~_goes_on(contrast) if blurred else slope, np.uint8(0), contrast)
    return _hysteresis(sharp, low=max(strong / 2, floor), high=strong)


def _slopes(contrast: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return what is far lighter than a neighbour: the slopes that blur lays beside every line."""
    highest = cv2.dilate(contrast, np.ones((3, 3), np.uint8))
    return np.asarray(cv2.convertScaleAbs(highest, alpha=_FRINGE) > contrast, dtype=np.bool_)


def _goes_on(contrast: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return where a light line runs into a heavy one: darker on one side, on the other hardly lighter."""
    out = np.zeros(contrast.shape, dtype=np.bool_)
    least = cv2.convertScaleAbs(contrast, alpha=_GOES_ON)
    for ahead, behind in _OPPOSITE:
        is_beside = cv2.convertScaleAbs(cv2.dilate(contrast, ahead), alpha=_FRINGE) > contrast
        out |= is_beside & (cv2.erode(contrast, behind) > least)
    return out


def _spread(contrast: NDArray[np.uint8]) -> float:
    """Return the standard deviation of the bare paper: from the median absolute deviation, deaf to ink."""
    sample = contrast[:: max(1, contrast.shape[0] // 1000), :: max(1, contrast.shape[1] // 1000)]
    return 1.4826 * float(np.median(np.abs(sample.astype(np.float32) - np.median(sample))))


def _hysteresis(contrast: NDArray[np.uint8], *, low: float, high: float) -> NDArray[np.bool_]:
    weak = (contrast > low).view(np.uint8)
    count, labels = cv2.connectedComponents(weak, connectivity=8)
    holds = np.zeros(count, dtype=bool)
    holds[labels[contrast > high]] = True
    holds[0] = False
    return np.asarray(holds[labels], dtype=np.bool_)
