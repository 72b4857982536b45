"""Pictures for people: walls, strokes and points from above, with a scale bar."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]

WALL: Colour = (20, 20, 20)
PARTITION: Colour = (0, 92, 175)
COLUMN: Colour = (110, 60, 150)
LAYER: Colour = (0, 140, 90)
BODY: Colour = (214, 214, 214)
GONE: Colour = (205, 40, 40)
REMOVED: Colour = (238, 178, 140)
_BY_LAYER: dict[str, Colour] = {
    "text": (205, 40, 80),
    "dimension": (240, 150, 30),
    "hatch": (150, 190, 60),
    "furniture": (60, 170, 200),
    "stair": (190, 90, 200),
    "door": (40, 160, 90),
    "window": (80, 130, 240),
    "frame": (150, 130, 110),
    "grid": (190, 160, 120),
    "dashed": (230, 110, 170),
    "symbol": (255, 120, 80),
    "speck": (200, 200, 120),
    "light-pen": (160, 180, 200),
    "small": (210, 150, 150),
    "column": COLUMN,
    "wall": (90, 90, 90),
}
_LONGEST_SIDE = 1600
_MARGIN = 24
_FOOTER = 48
_ROW = 22
_LETTERS = 14


@dataclass(frozen=True, eq=False)
class Drawn:
    """Hold lines, filled areas or points of one colour: (K, 2) arrays in the picture's frame, y up.

    What has a `label` stands in the picture's legend.
    """

    colour: Colour
    lines: tuple[NDArray[np.float64], ...] = ()
    points: NDArray[np.float64] | None = None
    width: int = 1
    areas: tuple[NDArray[np.float64], ...] = ()
    label: str = ""


def colour_of(layer: str) -> Colour:
    """Return the colour in which a layer that was set aside is shown."""
    return _BY_LAYER.get(layer, REMOVED)


def write_preview(
    path: Path,
    layers: Iterable[Drawn],
    *,
    low: tuple[float, float],
    high: tuple[float, float],
    unit: str = "m",
) -> None:
    """Write a PNG of the rectangle from `low` to `high`, y up, with a scale bar in `unit` and a legend.

    Later layers lie over earlier ones. The same input gives the same bytes.
    """
    layers = list(layers)
    extent = max(high[0] - low[0], high[1] - low[1], 1e-6)
    zoom = (_LONGEST_SIDE - 2 * _MARGIN) / extent
    width = math.ceil((high[0] - low[0]) * zoom) + 2 * _MARGIN
    width = max(width, 240)
    entries = _legend(layers, width)
    footer = _FOOTER + _ROW * (1 + max((row for _, _, row in entries), default=-1))
    height = math.ceil((high[1] - low[1]) * zoom) + 2 * _MARGIN + footer
    image = Image.new("RGB", (width, height), (255, 255, 255))
    pen = ImageDraw.Draw(image)

    def to_px(parts: Sequence[NDArray[np.float64]]) -> Iterator[list[float]]:
        """Yield each part as x and y in turn; all are turned to pixels at once."""
        if not parts:
            return
        px = (np.concatenate(parts) - np.array(low)) * zoom
        px = np.column_stack([px[:, 0] + _MARGIN, (height - footer - _MARGIN) - px[:, 1]])
        end = np.cumsum([2 * len(part) for part in parts]).tolist()
        flat = px.ravel().tolist()
        yield from (flat[a:b] for a, b in pairwise([0, *end]))

    for layer in layers:
        for area in to_px(layer.areas):
            pen.polygon(area, fill=layer.colour)
        for line in to_px(layer.lines):
            pen.line(line, fill=layer.colour, width=layer.width)
        if layer.points is not None and len(layer.points):
            pen.point(next(to_px([layer.points])), fill=layer.colour)
    _scale_bar(pen, zoom, height - footer + 8, unit)
    for drawn, x, row in entries:
        y = height - footer + _FOOTER + row * _ROW
        pen.line([(x, y + 8), (x + 24, y + 8)], fill=drawn.colour, width=4)
        pen.text((x + 30, y), drawn.label, fill=(0, 0, 0), font=ImageFont.load_default(size=_LETTERS))
    image.save(path, format="PNG", optimize=False)


def _legend(layers: list[Drawn], width: int) -> list[tuple[Drawn, float, int]]:
    """Return what the legend shows, each with its place from the left and its row, one of a label."""
    out: list[tuple[Drawn, float, int]] = []
    font = ImageFont.load_default(size=_LETTERS)
    x, row, seen = float(_MARGIN), 0, set()
    for layer in reversed(layers):
        if not layer.label or layer.label in seen:
            continue
        seen.add(layer.label)
        need = 30 + font.getlength(layer.label) + 24
        if x + need > width and x > _MARGIN:
            x, row = float(_MARGIN), row + 1
        out.append((layer, x, row))
        x += need
    return out


def _scale_bar(pen: ImageDraw.ImageDraw, zoom: float, y: int, unit: str) -> None:
    """Draw a bar of a round length, between a twelfth and a fifth of the picture."""
    longest = _LONGEST_SIDE / 5 / zoom
    power = 10.0 ** math.floor(math.log10(longest))
    length = max(step * power for step in (1, 2, 5) if step * power <= longest)
    x0 = _MARGIN
    x1 = x0 + length * zoom
    pen.line([(x0, y), (x1, y)], fill=(0, 0, 0), width=3)
    for x in (x0, x1):
        pen.line([(x, y - 6), (x, y + 6)], fill=(0, 0, 0), width=2)
    pen.text((x0, y + 10), f"{length:g} {unit}", fill=(0, 0, 0), font=ImageFont.load_default(size=16))
