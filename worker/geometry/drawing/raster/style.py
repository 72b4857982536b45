"""How a drawing shows its walls: filled, in outline, or as single lines."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.raster.ink import Ink
from worker.geometry.drawing.raster.pairs import find_pairs
from worker.geometry.drawing.raster.pens import paired_length
from worker.geometry.drawing.raster.strokes import Strokes
from worker.geometry.drawing.reading.reading import Wall

_SPAN = 0.5
_LIGHT_FILL, _SURE_PX = 0.5, 4.0
_LEAST_BAR, _JOINED, _TOUCH = 0.8, 0.5, 0.05
_SHARE_OF_LINES, _SHARE_OF_PAIRS = 0.12, 0.6


def is_filled(strokes: Strokes, bars: list[Wall], lines: NDArray[np.bool_], ink: Ink) -> bool:
    """Return whether the walls are the `bars`, and the thin `lines` are not.

    Filled walls join at corners, span the drawing, are a fair part of all that is drawn, and are longer than
    the walls that the thin lines would make: half the length of those that run in pairs.
    """
    bars = [w for w in bars if w.length >= _LEAST_BAR]
    if not bars or _joined(bars) < _JOINED:
        return False
    length = strokes.length * ink.metres_per_px
    filled = sum(w.length for w in bars)
    tips = np.concatenate([w.centre for w in bars])
    everything = ink.to_drawing(strokes.ends.reshape(-1, 2))
    wide = np.ptp(np.percentile(everything, [5, 95], axis=0), axis=0)
    if (np.ptp(tips, axis=0) < _SPAN * wide).any() or filled < _SHARE_OF_LINES * float(length[lines].sum()):
        return False
    pairs = find_pairs(strokes, ink.metres_per_px, among=lines)
    return filled >= _SHARE_OF_PAIRS * paired_length(pairs, lines, length) / 2.0


def by_darkness(ink: Ink, bars: list[Wall]) -> tuple[list[Wall], list[Wall]]:
    """Return the bars filled as darkly as most, and those less than half as dark: furniture, floors."""
    dark = np.array([_darkness(ink, w) for w in bars])
    length = np.array([w.length for w in bars])
    order = np.argsort(dark, kind="stable")
    passed = np.cumsum(length[order])
    usual = dark[order[int(np.searchsorted(passed, passed[-1] / 2))]]
    light = (dark < _LIGHT_FILL * usual) & (
        np.array([w.thickness for w in bars]) >= _SURE_PX * ink.metres_per_px
    )
    return (
        [w for w, gone in zip(bars, light, strict=True) if not gone],
        [w for w, gone in zip(bars, light, strict=True) if gone],
    )


def _darkness(ink: Ink, wall: Wall) -> float:
    """Return the median contrast along a centre line."""
    share = np.linspace(0.05, 0.95, 15)[:, None]
    along = wall.centre[0] + (wall.centre[-1] - wall.centre[0]) * share
    px = np.rint(_to_px(ink, along)).astype(int)
    columns = px[:, 0].clip(0, ink.contrast.shape[1] - 1)
    return float(np.median(ink.contrast[px[:, 1].clip(0, ink.contrast.shape[0] - 1), columns]))


def _to_px(ink: Ink, xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 2) points of frame `drawing` in working pixels, x right and y down."""
    origin, right, down = ink.to_drawing(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    turn = np.column_stack([right - origin, down - origin])
    return np.asarray(np.linalg.solve(turn, (xy - origin).T).T, dtype=np.float64)


def _joined(bars: list[Wall]) -> float:
    """Return the share of the bars' length that has an end on another bar: dashes have none."""
    bodies = shapely.linestrings([w.centre for w in bars])
    reach = np.array([w.thickness / 2 + _TOUCH for w in bars])
    tree = shapely.STRtree(bodies)
    joined = np.zeros(len(bars), dtype=bool)
    for end in (0, -1):
        tips = shapely.points([w.centre[end] for w in bars])
        one, other = tree.query(tips, predicate="dwithin", distance=2 * float(reach.max()))
        near = (one != other) & (shapely.distance(tips[one], bodies[other]) <= reach[one] + reach[other])
        joined[one[near]] = True
        joined[other[near]] = True
    length = np.array([w.length for w in bars])
    return float(length[joined].sum() / length.sum())
