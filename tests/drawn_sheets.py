"""Sheets with dimensions, title blocks and scale bars that tests draw themselves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Point = tuple[float, float]


class DrawnSheet:
    """Draw black on white, y down, in pixels."""

    def __init__(self, width: int = 2000, height: int = 1400, *, letters: int = 30) -> None:
        self.image = Image.new("L", (width, height), 255)
        self.draw = ImageDraw.Draw(self.image)
        self.font = ImageFont.load_default(letters)
        self.letters = letters

    @property
    def grey(self) -> NDArray[np.uint8]:
        """Return the pixels."""
        return np.array(self.image)

    def write(self, text: str, at: Point, *, degrees: float = 0.0) -> None:
        """Write a text with its middle at a point, turned counter-clockwise."""
        x0, y0, x1, y1 = self.font.getbbox(text)
        tile = Image.new("L", (math.ceil(x1 - x0) + 8, math.ceil(y1 - y0) + 8), 0)
        ImageDraw.Draw(tile).text((4 - x0, 4 - y0), text, font=self.font, fill=255)
        tile = tile.rotate(degrees, expand=True, resample=Image.Resampling.BICUBIC)
        self.image.paste(0, (round(at[0] - tile.width / 2), round(at[1] - tile.height / 2)), tile)

    def line(self, *points: Point, width: int = 2) -> None:
        """Draw a line through points."""
        self.draw.line([tuple(p) for p in points], fill=0, width=width)

    def walls(self, corners: Sequence[Point], *, width: int = 14) -> None:
        """Draw a closed row of filled walls."""
        self.line(*corners, corners[0], width=width)

    def dimension(
        self, start: Point, end: Point, text: str, *, away: float = 90.0, arrows: bool = False
    ) -> None:
        """Draw a dimension `away` from two points, on the left of the way from start to end."""
        p, q = np.array(start, float), np.array(end, float)
        u = (q - p) / np.hypot(*(q - p))
        n = np.array([u[1], -u[0]])
        a, b = p + n * away, q + n * away
        for foot, head in ((p, a), (q, b)):
            self.line(tuple(foot + n * 14), tuple(head + n * 10))
        self.line(tuple(a), tuple(b))
        for place, inward in ((a, u), (b, -u)):
            if arrows:
                tip = [place, place + inward * 26 + n * 5, place + inward * 26 - n * 5]
                self.draw.polygon([tuple(c) for c in tip], fill=0)
            else:
                self.line(tuple(place - (u + n) * 11), tuple(place + (u + n) * 11), width=4)
        degrees = math.degrees(math.atan2(-u[1], u[0]))
        degrees = (degrees + 89.9) % 180 - 89.9
        up = np.array([-math.sin(math.radians(degrees)), -math.cos(math.radians(degrees))])
        middle = (a + b) / 2 + up * self.letters * 0.8
        self.write(text, (middle[0], middle[1]), degrees=degrees)

    def scale_bar(self, at: Point, *, px_per_unit: float, numbers: Sequence[int], unit: str) -> None:
        """Draw a scale bar from a point to the right, with its numbers over it and the unit at the last."""
        x, y = at
        places = [x + n * px_per_unit for n in numbers]
        for i, (a, b) in enumerate(pairwise(places)):
            self.draw.rectangle([a, y - 12, b, y], outline=0, fill=0 if i % 2 == 0 else 255, width=2)
        for place, number in zip(places, numbers, strict=True):
            self.write(str(number), (place, y - 12 - self.letters))
        shift = self.font.getlength(str(numbers[-1])) / 2 + self.font.getlength(f" {unit}") / 2
        self.write(unit, (places[-1] + shift + 4, y - 12 - self.letters))
