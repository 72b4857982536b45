"""How well each wall of a sheet is supported by what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.reading.reading import Wall

_TOUCH = 0.12
_BASE = {"filled": 0.6, "outlined": 0.55, "partition": 0.4}
_END, _LONG, _LONG_ENOUGH = 0.15, 0.1, 1.0
_OUT_OF_STYLE = 0.6


def with_confidence(walls: list[Wall], *, filled: int, style: str) -> list[Wall]:
    """Return the walls with `confidence` set, and the reason for it.

    Parameters
    ----------
    walls : list of Wall
        The first `filled` of them are solid bars; the others are pairs of lines, or single lines where their
        kind is ``partition``.
    filled : int
        How many are bars.
    style : str
        How the drawing shows its walls: what is drawn otherwise is less sure.

    Notes
    -----
    A bar or a pair of faces is better support than one line; each end on another wall adds 0.15, a length of
    a metre 0.1. A drawing made of single lines has no better walls, so there a line is worth a pair.
    """
    if not walls:
        return walls
    joined = _ends_joined(walls)
    out = []
    for k, wall in enumerate(walls):
        drawn = "filled" if k < filled else ("partition" if wall.kind == "partition" else "outlined")
        own_style = style == ("single-line" if drawn == "partition" else drawn)
        base = _BASE["outlined"] if drawn == "partition" and own_style else _BASE[drawn]
        value = base + _END * int(joined[k]) + _LONG * min(1.0, wall.length / _LONG_ENOUGH)
        value *= 1.0 if own_style or style == "outlined" else _OUT_OF_STYLE
        out.append(replace(wall, confidence=round(min(1.0, value), 2), reason=_reason(drawn, int(joined[k]))))
    return out


def _reason(drawn: str, ends: int) -> str:
    what = {
        "filled": "a solid bar",
        "outlined": "two faces drawn side by side",
        "partition": "one line of the walls' own pen",
    }[drawn]
    return f"{what}, {('no end', 'one end', 'both ends')[ends]} on another wall"


def _ends_joined(walls: list[Wall]) -> NDArray[np.int64]:
    """Return how many of the two ends of each wall lie on another wall's body."""
    lines = shapely.linestrings([w.centre for w in walls])
    half = np.array([w.thickness / 2 for w in walls])
    tree = shapely.STRtree(lines)
    count = np.zeros(len(walls), dtype=np.int64)
    for end in (0, -1):
        tips = shapely.points([w.centre[end] for w in walls])
        one, other = tree.query(tips, predicate="dwithin", distance=2 * float(half.max()) + _TOUCH)
        near = (one != other) & (
            shapely.distance(tips[one], lines[other]) <= half[one] + half[other] + _TOUCH
        )
        count[np.unique(one[near])] += 1
    return count
