"""Pictures for people: walls, strokes and points from above, with a scale bar."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]

WALL: Colour = (20, 20, 20)
PARTITION: Colour = (0, 92, 175)
COLUMN: Colour = (110, 60, 150)
LAYER: Colour = (0, 140, 90)
REMOVED: Colour = (235, 130, 110)
_LONGEST_SIDE = 1600
_MARGIN = 24
_FOOTER = 48


@dataclass(frozen=True, eq=False)
class Drawn:
    """Hold lines or points of one colour: (K, 2) arrays in the picture's frame, y up."""

    colour: Colour
    lines: tuple[NDArray[np.float64], ...] = ()
    points: NDArray[np.float64] | None = None
    width: int = 1


def write_preview(
    path: Path,
    layers: Iterable[Drawn],
    *,
    low: tuple[float, float],
    high: tuple[float, float],
    unit: str = "m",
) -> None:
    """Write a PNG of the rectangle from `low` to `high`, y up, with a scale bar in `unit`.

    Later layers lie over earlier ones. The same input gives the same bytes.
    """
    extent = max(high[0] - low[0], high[1] - low[1], 1e-6)
    zoom = (_LONGEST_SIDE - 2 * _MARGIN) / extent
    width = math.ceil((high[0] - low[0]) * zoom) + 2 * _MARGIN
    height = math.ceil((high[1] - low[1]) * zoom) + 2 * _MARGIN + _FOOTER
    image = Image.new("RGB", (max(width, 240), height), (255, 255, 255))
    pen = ImageDraw.Draw(image)

    def to_px(xy: NDArray[np.float64]) -> list[tuple[float, float]]:
        px = (xy - np.array(low)) * zoom
        return [(float(x) + _MARGIN, float(height - _FOOTER - _MARGIN - y)) for x, y in px]

    for layer in layers:
        for line in layer.lines:
            pen.line(to_px(line), fill=layer.colour, width=layer.width)
        if layer.points is not None and len(layer.points):
            pen.point(to_px(layer.points), fill=layer.colour)
    _scale_bar(pen, zoom, height, unit)
    image.save(path, format="PNG", optimize=False)


def _scale_bar(pen: ImageDraw.ImageDraw, zoom: float, height: int, unit: str) -> None:
    """Draw a bar of a round length, between a twelfth and a fifth of the picture."""
    longest = _LONGEST_SIDE / 5 / zoom
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(step * power for step in (1, 2, 5) if step * power <= longest)
    y, x0 = height - _FOOTER + 8, _MARGIN
    x1 = x0 + length * zoom
    pen.line([(x0, y), (x1, y)], fill=(0, 0, 0), width=3)
    for x in (x0, x1):
        pen.line([(x, y - 6), (x, y + 6)], fill=(0, 0, 0), width=2)
    pen.text((x0, y + 10), f"{length:g} {unit}", fill=(0, 0, 0), font=ImageFont.load_default(size=16))
