"""The hall's design drawing on paper: walls, doors, dimension lines, lettering, title block, frame."""

from __future__ import annotations

import io
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from demo.hall import METRES_PER_PX, Door, Hall, Rectangle

Point = tuple[float, float]


@dataclass(frozen=True)
class KnownLength:
    """Hold two points of a sheet (pixels, x right, y down) and their real distance [m]."""

    x1: float
    y1: float
    x2: float
    y2: float
    length_m: float


def known_length(hall: Hall) -> KnownLength:
    """Return what a person would click: the ends of the overall dimension, and the number lettered on it."""
    o = hall.outline
    (x1, y1), (x2, y2) = _to_px(hall, (o.x0, o.y0)), _to_px(hall, (o.x1, o.y0))
    return KnownLength(x1, y1, x2, y2, o.size[0])


def drawing_png(hall: Hall) -> bytes:
    """Return the drawing as a PNG file: 8-bit grey, one pixel for `METRES_PER_PX` metres, machines left out.

    Solid walls and columns; thin lines for all that a map must not take for walls: door leaves and their
    swing, dimension lines with their numbers in millimetres, axis marks, room names, frame and title block.
    """
    width, height = (round(side / METRES_PER_PX) for side in hall.sheet_size)
    image = Image.new("L", (width, height), 255)
    pen = _Pen(hall, ImageDraw.Draw(image), image)
    for solid in (*hall.walls, *hall.columns):
        pen.fill(solid)
    for door in hall.doors:
        _door(pen, door)
    _dimensions(pen, hall)
    _lettering(pen, hall)
    _frame_and_title(pen, hall)
    out = io.BytesIO()
    image.save(out, "PNG", optimize=False)
    return out.getvalue()


def _to_px(hall: Hall, point: Point) -> Point:
    return point[0] / METRES_PER_PX, (hall.sheet_size[1] - point[1]) / METRES_PER_PX


@dataclass(frozen=True)
class _Pen:
    """Draw on the sheet in its metres (x right, y up)."""

    hall: Hall
    draw: ImageDraw.ImageDraw
    image: Image.Image

    def fill(self, solid: Rectangle) -> None:
        """Blacken exactly the pixels inside a rectangle whose edges lie on pixel edges."""
        (x0, y1), (x1, y0) = (_to_px(self.hall, p) for p in ((solid.x0, solid.y0), (solid.x1, solid.y1)))
        self.draw.rectangle((round(x0), round(y0), round(x1) - 1, round(y1) - 1), fill=0)

    def line(self, *points: Point, weight: int = 1) -> None:
        self.draw.line([_to_px(self.hall, point) for point in points], fill=0, width=weight)

    def text(self, at: Point, words: str, *, height_px: int = 22, upright: bool = False) -> None:
        """Letter words around a point, turned to be read from the right if upright."""
        font = ImageFont.load_default(size=height_px)
        left, top, right, bottom = (round(v) for v in font.getbbox(words))
        patch = Image.new("L", (right - left + 4, bottom - top + 4), 255)
        ImageDraw.Draw(patch).text((2 - left, 2 - top), words, fill=0, font=font)
        if upright:
            patch = patch.transpose(Image.Transpose.ROTATE_90)
        x, y = _to_px(self.hall, at)
        self.image.paste(patch, (round(x - patch.width / 2), round(y - patch.height / 2)))

    def arc(self, centre: Point, radius: float, start_deg: float, end_deg: float) -> None:
        """Draw an arc counted counter-clockwise from x, seen with y up [deg]."""
        x, y = _to_px(self.hall, centre)
        r = radius / METRES_PER_PX
        self.draw.arc((x - r, y - r, x + r, y + r), -end_deg, -start_deg, fill=0, width=1)


def _door(pen: _Pen, door: Door) -> None:
    """Draw a leaf that stands open at a right angle, and its swing; wide gates have two leaves."""
    o = door.opening
    width = o.size[0] if door.along_x else o.size[1]
    leaf = width / 2 if width > 2 else width
    if door.along_x:
        pen.line((o.x0, o.y1), (o.x0, o.y1 + leaf), weight=2)
        pen.arc((o.x0, o.y1), leaf, 0, 90)
        if leaf < width:
            pen.line((o.x1, o.y1), (o.x1, o.y1 + leaf), weight=2)
            pen.arc((o.x1, o.y1), leaf, 90, 180)
    else:
        pen.line((o.x1, o.y0), (o.x1 + leaf, o.y0), weight=2)
        pen.arc((o.x1, o.y0), leaf, 0, 90)


def _dimensions(pen: _Pen, hall: Hall) -> None:
    """Draw a chain of part dimensions and the overall one, below and to the left."""
    o, shop, store = hall.outline, hall.rooms[0].floor, hall.rooms[3].floor
    _chain(pen, [(x, o.y0 - 1.0) for x in (o.x0, shop.x1, store.x0, o.x1)], from_=o.y0)
    _chain(pen, [(x, o.y0 - 1.9) for x in (o.x0, o.x1)], from_=o.y0)
    _chain(pen, [(o.x0 - 1.0, y) for y in (o.y0, shop.y1, o.y1)], from_=o.x0)
    _chain(pen, [(o.x0 - 1.9, y) for y in (o.y0, o.y1)], from_=o.x0)


def _chain(pen: _Pen, marks: list[Point], *, from_: float) -> None:
    """Draw a dimension line through its marks: extension lines, oblique ticks, numbers in millimetres."""
    upright = marks[0][0] == marks[-1][0]
    over = 0.2
    first, last = np.array(marks[0]), np.array(marks[-1])
    along = (last - first) / np.linalg.norm(last - first)
    pen.line(tuple(first - along * over), tuple(last + along * over))
    for x, y in marks:
        if upright:
            pen.line((from_ - 0.25, y), (x - over, y))
        else:
            pen.line((x, from_ - 0.25), (x, y - over))
        pen.line((x - 0.12, y - 0.12), (x + 0.12, y + 0.12), weight=2)
    for a, b in pairwise(marks):
        length_mm = round(1000 * float(np.hypot(b[0] - a[0], b[1] - a[1])))
        middle = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
        beside = (middle[0] - 0.32, middle[1]) if upright else (middle[0], middle[1] + 0.32)
        pen.text(beside, str(length_mm), upright=upright)


def _lettering(pen: _Pen, hall: Hall) -> None:
    for room in hall.rooms:
        x, y = room.floor.centre
        pen.text((x, y + 0.3), room.name, height_px=26)
        area = room.floor.size[0] * room.floor.size[1]
        pen.text((x, y - 0.3), f"{area:.1f} m2", height_px=20)
    lowest = sorted({column.centre[0] for column in hall.columns})
    for number, x in enumerate(lowest, start=1):
        y = hall.outline.y1 + 1.3
        pen.line((x, hall.outline.y1 + 0.3), (x, y - 0.4))
        pen.arc((x, y), 0.4, 0, 360)
        pen.text((x, y), str(number), height_px=24)


def _frame_and_title(pen: _Pen, hall: Hall) -> None:
    width, height = hall.sheet_size
    edge = 0.4
    right, upper = width - edge, height - edge
    pen.line((edge, edge), (right, edge), (right, upper), (edge, upper), (edge, edge), weight=3)
    left, top, row = width - edge - 9.0, edge + 2.4, 0.6
    pen.line((left, edge), (left, top), (width - edge, top), weight=3)
    rows = ("GROUNDPLAN DEMONSTRATION WORKS", "GENERAL ARRANGEMENT - GROUND FLOOR",
            f"DRAWING No GP-{hall.seed:04d}    REV A", "SCALE 1:100    DIMENSIONS IN mm")  # fmt: skip
    for number, words in enumerate(rows):
        y = top - row * (number + 0.5)
        pen.text((left + 4.5, y), words, height_px=20)
        if number:
            pen.line((left, top - row * number), (width - edge, top - row * number))
