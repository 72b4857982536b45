"""What a bad scanner does to a sheet: specks, dark ones on paper and light ones in ink, and blur."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

_TILE, _TILES = 192, 7
_DEEP = 40
_SHARE = 3e-4
_EDGE, _STEP, _SHARP_SHARE = 60, 0.72, 0.05
_STRIP_ROWS = 512
_BLUR, _ROUNDS, _ROUND_ROWS = 0.8, 12, 72
_HEADINGS, _LONG = 16, 9
_RING = np.array([[1, 1, 1], [1, 0, 1], [1, 1, 1]], dtype=np.uint8)
_WINDOW = np.ones((5, 5), dtype=np.uint8)
_PAIRS = (
    np.array([[0, 0, 0], [1, 0, 1], [0, 0, 0]], dtype=np.uint8),
    np.array([[0, 1, 0], [0, 0, 0], [0, 1, 0]], dtype=np.uint8),
    np.array([[1, 0, 0], [0, 0, 0], [0, 0, 1]], dtype=np.uint8),
    np.array([[0, 0, 1], [0, 0, 0], [1, 0, 0]], dtype=np.uint8),
)


def is_speckled(grey: NDArray[np.uint8]) -> bool:
    """Return whether a (H, W) sheet is strewn with single dark pixels: more than 3 in 10,000.

    Only 49 tiles are looked at. Three in four have to agree, so that dotted hatches do not count.
    """
    shares = [float((cv2.subtract(cv2.erode(tile, _RING), tile) > _DEEP).mean()) for tile in _tiles(grey)]
    return float(np.percentile(shares, 25)) > _SHARE


def is_blurred(contrast: NDArray[np.uint8]) -> bool:
    """Return whether the edges of a (H, W) sheet are soft: nearly none rises within one pixel."""
    edges = sharp = 0
    for tile in _tiles(contrast):
        rise = cv2.subtract(cv2.dilate(tile, np.ones((3, 3), np.uint8)), tile)
        whole = cv2.subtract(cv2.dilate(tile, _WINDOW), cv2.erode(tile, _WINDOW))
        edge = whole > _EDGE
        edges += int(edge.sum())
        sharp += int((edge & (rise > _STEP * whole)).sum())
    return edges > 0 and sharp < _SHARP_SHARE * edges


def sharpened(contrast: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the (H, W) contrast without a blur of 0.8 px, so that lines two pixels apart come apart again.

    Notes
    -----
    Deconvolution of Richardson (1972) and Lucy (1974): light is neither made nor lost, so the sum across a
    line stays. Twelve rounds: more break faint lines up. In strips of rows, so that it needs little memory.
    """
    out = np.zeros_like(contrast)
    height = contrast.shape[0]
    for top in range(0, height, _STRIP_ROWS):
        bottom = min(height, top + _STRIP_ROWS)
        low, high = max(0, top - _ROUND_ROWS), min(height, bottom + _ROUND_ROWS)
        seen = contrast[low:high].astype(np.float32) + 0.5
        true = seen.copy()
        for _ in range(_ROUNDS):
            true *= cv2.GaussianBlur(seen / cv2.GaussianBlur(true, (0, 0), _BLUR), (0, 0), _BLUR)
        out[top:bottom] = np.clip(true[top - low : bottom - low], 0.0, 255.0).astype(np.uint8)
    return out


def mended(contrast: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the (H, W) contrast with lines that a bad scan broke up, and without what it strewed about.

    It is the geometric mean of the contrast and of its mean over 9 px in that of 16 directions in which it is
    darkest: that of the line through the pixel.
    """
    along = np.zeros_like(contrast)
    for k in range(_HEADINGS):
        cv2.max(along, cv2.filter2D(contrast, -1, _segment(np.pi * k / _HEADINGS)), dst=along)
    both = cv2.multiply(contrast, along, dtype=cv2.CV_32F)
    return np.asarray(cv2.sqrt(both, dst=both), dtype=np.uint8)


def _segment(angle: float) -> NDArray[np.float32]:
    """Return the weights of the mean along a line of 9 px through the middle."""
    share = np.linspace(-(_LONG // 2), _LONG // 2, 4 * _LONG + 1)
    weights = np.zeros((_LONG, _LONG), dtype=np.float32)
    x, y = share * np.cos(angle) + _LONG // 2, share * np.sin(angle) + _LONG // 2
    at = np.unique(np.rint(np.column_stack([y, x])).astype(int), axis=0)
    weights[at[:, 0], at[:, 1]] = 1.0
    return np.asarray(weights / weights.sum(), dtype=np.float32)


def _tiles(grey: NDArray[np.uint8]) -> Iterator[NDArray[np.uint8]]:
    height, width = grey.shape
    for y in np.linspace(0, max(0, height - _TILE), _TILES).astype(int):
        for x in np.linspace(0, max(0, width - _TILE), _TILES).astype(int):
            yield np.ascontiguousarray(grey[y : y + _TILE, x : x + _TILE])


def without_specks(grey: NDArray[np.uint8], *, fill: bool) -> NDArray[np.uint8]:
    """Return the sheet without pixels that are darker or lighter than all their neighbours.

    Lines one pixel wide stay, for each of their pixels has a neighbour in the line. Where `fill`, a pixel
    between two darker ones, opposite each other, is as dark as the lighter of them: it closes the holes of
    one pixel that light specks leave in such lines.

    Notes
    -----
    In strips of rows: one byte a pixel for the result.
    """
    out = np.zeros_like(grey)
    height = grey.shape[0]
    for top in range(0, height, _STRIP_ROWS):
        bottom = min(height, top + _STRIP_ROWS)
        low, high = max(0, top - 2), min(height, bottom + 2)
        lifted = cv2.max(grey[low:high], cv2.erode(grey[low:high], _RING))
        clean = cv2.min(lifted, cv2.dilate(lifted, _RING))
        for pair in _PAIRS if fill else ():
            clean = cv2.min(clean, cv2.dilate(lifted, pair, borderType=cv2.BORDER_REPLICATE))
        out[top:bottom] = clean[top - low : bottom - low]
    return out
