"""What is no wall is set aside (paper, section 2.2, step 2): specks, text, symbols, lines from dot to dot."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from worker.geometry.drawing.raster.opening import opened
from worker.geometry.drawing.raster.parts import Parts
from worker.geometry.drawing.raster.squeeze import Squeezed
from worker.geometry.drawing.raster.strokes import Strokes

SPECK, TEXT, SYMBOL = 0.12, 0.7, 2.4
_BOX_ASPECT, _BOX_THICKEST, _BOX_SHORTEST = 2.2, 0.45, 0.5
_PIER_FILL, _PIER_LEAST = 0.8, 0.15
_LETTER_WIDEST, _PIECES = 1.3, 2
_LETTERS, _LETTER_GAP, _LETTER_HIGHEST, _WORD_LONGEST = 3, 0.6, 0.8, 4.0
_DOTS, _DOT_SHARE, _DOT_WIDEST = 3, 0.6, 0.9
_DOT_REACH, _DOT_LINES, _DOT_LEAST, _LINES_A_DOT = 0.3, 2.0, 0.2, 4


def small_parts(strokes: Strokes, parts: Parts, metres_per_px: float) -> dict[str, NDArray[np.bool_]]:
    """Return, by layer, which strokes belong to specks, text and symbols.

    A free-standing part is spared that is long and narrow as a wall drawn in outline, or solid as a pier,
    unless it stands in a row of letters.
    """
    box = (
        (parts.short <= _BOX_THICKEST)
        & (parts.long >= _BOX_SHORTEST)
        & (parts.long >= _BOX_ASPECT * parts.short)
        & (parts.short >= max(0.05, 4 * metres_per_px))
    )
    box |= (parts.fill >= _PIER_FILL) & (parts.short >= _PIER_LEAST)
    words = _words(parts, metres_per_px)
    speck = parts.long < SPECK
    text = ~speck & (((parts.long < TEXT) & ~box) | words)
    symbol = ~speck & ~text & (parts.long < SYMBOL) & ~box
    return {
        name: which[strokes.part] for name, which in (("speck", speck), ("text", text), ("symbol", symbol))
    }


def _words(parts: Parts, metres_per_px: float) -> NDArray[np.bool_]:
    """Return which parts are letters, or several that touch: at least three in a row, close, equally high."""
    out = np.zeros(len(parts.long), dtype=bool)
    size = parts.box[:, 2:] * metres_per_px
    some = np.flatnonzero((size.min(axis=1) <= _LETTER_HIGHEST) & (parts.extent <= _WORD_LONGEST))
    some = some[(some > 0) & (parts.extent[some] >= SPECK / 2)]
    for upright in (True, False):
        high = size[some, 1] if upright else size[some, 0]
        letters = some[high <= _LETTER_HIGHEST]
        out[_rows_of_letters(parts.box[letters] * metres_per_px, letters, upright=upright)] = True
    return out


def _rows_of_letters(
    box: NDArray[np.float64], letters: NDArray[np.int64], *, upright: bool
) -> NDArray[np.int64]:
    """Return which of the letters stand in a row, along x where `upright`, else along y."""
    a, b = (0, 1) if upright else (1, 0)
    if len(letters) < _LETTERS:
        return letters[:0]
    low, high = box[:, a], box[:, a] + box[:, 2 + a]
    middle, tall = box[:, b] + box[:, 2 + b] / 2, box[:, 2 + b]
    reach = _WORD_LONGEST / 2 + _LETTER_GAP * _LETTER_HIGHEST
    pairs = cKDTree(np.column_stack([(low + high) / 2, middle])).query_pairs(reach, output_type="ndarray")
    i, j = pairs.T
    gap = np.maximum(low[i], low[j]) - np.minimum(high[i], high[j])
    small, large = np.minimum(tall[i], tall[j]), np.maximum(tall[i], tall[j])
    near = (gap <= _LETTER_GAP * large) & (np.abs(middle[i] - middle[j]) <= 0.35 * large)
    near &= (large <= 1.9 * small) & (gap >= -0.3 * large)
    group = _groups(len(letters), pairs[near])
    wide = (high - low) / np.maximum(tall, 1e-9)
    count = np.bincount(group, weights=np.clip(1.4 * wide, 1.0, 6.0))
    letter_like = np.bincount(group, weights=wide <= _LETTER_WIDEST)
    several = np.bincount(group) >= _PIECES
    return letters[several[group] & (count[group] >= _LETTERS) & (letter_like[group] >= 1)]


def _groups(count: int, links: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the group of each of `count` items that the (L, 2) links join."""
    parent = list(range(count))

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for i, j in links.tolist():
        parent[root(i)] = root(j)
    return np.array([root(k) for k in range(count)], dtype=np.int64)


def from_dot_to_dot(strokes: Strokes, parts: Parts, metres_per_px: float) -> NDArray[np.bool_]:
    """Return which strokes belong to parts whose lines lead from one round dot to another.

    Lanes and way points of robots, leaders and markers are drawn so; a wall does not end in a disc. A dot is
    twice as wide as the lines of its part.
    """
    whole = np.bincount(strokes.part, strokes.length, len(parts.long))
    width = np.bincount(strokes.part, strokes.length * strokes.width, len(parts.long)) / np.maximum(
        whole, 1.0
    )
    usual = float(np.average(strokes.width, weights=strokes.length + 1e-6))
    dots, radius, owner = _dots(parts, max(4, int(np.ceil(1.6 * usual)) + 1), metres_per_px)
    large = 2 * radius >= _DOT_LINES * width[owner]
    dots, radius, owner = dots[large], radius[large], owner[large]
    out = np.zeros(len(strokes), dtype=bool)
    for part in np.flatnonzero(np.bincount(owner, minlength=len(parts.long)) >= _DOTS):
        own = np.flatnonzero((strokes.part == part) & (strokes.length * metres_per_px >= TEXT))
        if len(own) > _LINES_A_DOT * int((owner == part).sum()):
            continue
        tree = cKDTree(dots[owner == part])
        far, at = tree.query(strokes.ends[own].reshape(-1, 2))
        reach = radius[owner == part][at] + _DOT_REACH / metres_per_px
        at_dot = (far <= reach).reshape(-1, 2).mean(axis=1)
        length = strokes.length[own]
        if len(own) and (length * at_dot).sum() >= _DOT_SHARE * length.sum():
            out |= strokes.part == part
    return out


def _dots(
    parts: Parts, least: int, metres_per_px: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return middles (D, 2), radii and parts of the round solid spots at least so wide [working px]."""
    squeezed = Squeezed.of(opened(parts.labels > 0, least))
    _, _labels, stats, centres = cv2.connectedComponentsWithStats(
        squeezed.mask.view(np.uint8), connectivity=8
    )
    wide, high = stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT]
    across = (wide + high) / 2.0
    full = stats[:, cv2.CC_STAT_AREA] / np.maximum(np.pi / 4 * across**2, 1.0)
    round_ = (np.abs(wide - high) <= np.maximum(3, 0.35 * across)) & (full >= 0.6) & (full <= 1.2)
    round_ &= (across * metres_per_px <= _DOT_WIDEST) & (across >= np.maximum(4, _DOT_LEAST / metres_per_px))
    round_[0] = False
    middle = squeezed.in_whole(centres[round_])
    at = np.rint(middle).astype(int)
    return middle, across[round_] / 2, parts.labels[at[:, 1], at[:, 0]].astype(np.int64)
