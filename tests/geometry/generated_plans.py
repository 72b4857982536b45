"""Plans drawn by the tests: walls of every style, with all that a draughtsman adds, and their truth."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from PIL import Image, ImageDraw, ImageFont

SCALE = 0.01
WIDE, HIGH = 16.0, 12.0

Point = tuple[float, float]
Line = tuple[Point, Point]


@dataclass(frozen=True)
class Plan:
    """Hold a plan: the sheet, its walls as (start, end, thickness), and its door openings."""

    grey: np.ndarray
    walls: tuple[tuple[Point, Point, float], ...]
    doors: tuple[Line, ...]

    @property
    def body(self) -> shapely.Geometry:
        """Return what is wall, door openings left out."""
        return _body(self.walls, self.doors)


def _body(walls: tuple[tuple[Point, Point, float], ...], doors: tuple[Line, ...]) -> shapely.Geometry:
    solid = shapely.union_all(
        [
            shapely.LineString([a, b]).buffer(t / 2, cap_style="square", join_style="mitre")
            for a, b, t in walls
        ]
    )
    gaps = [shapely.LineString(d).buffer(0.4, cap_style="flat") for d in doors]
    return solid.difference(shapely.union_all(gaps))


def draw_plan(style: str, seed: int) -> Plan:
    """Return a plan of three rooms: style `filled`, `outlined`, `hatched` or `single-line`."""
    rng = np.random.default_rng(seed)
    outer, inner = float(rng.choice([0.24, 0.3, 0.36])), float(rng.choice([0.1, 0.12, 0.16]))
    left, right, low, high = 2.5, float(rng.uniform(12.5, 13.5)), 3.0, float(rng.uniform(9.5, 10.3))
    middle, cross = float(rng.uniform(6.5, 8.5)), float(rng.uniform(6.0, 7.0))
    walls = (
        ((left, low), (right, low), outer),
        ((right, low), (right, high), outer),
        ((right, high), (left, high), outer),
        ((left, high), (left, low), outer),
        ((middle, low), (middle, high), inner),
        ((middle, cross), (right, cross), inner),
    )
    doors = (
        ((middle, low + 0.8), (middle, low + 1.7)),
        ((middle + 1.2, cross), (middle + 2.1, cross)),
        ((left + 1.5, low), (left + 2.5, low)),
    )
    sheet = _Pen()
    body = _body(walls, doors)
    _draw_walls(sheet, style, body, walls, doors)
    _draw_doors(sheet, doors)
    _draw_stair(sheet, (left + 0.8, cross + 0.4))
    _draw_furniture(sheet, (middle + 1.5, low + 1.0))
    _draw_dimensions(sheet, left, right, low - 1.2)
    _draw_axis(sheet, middle, low - 0.7, high + 0.9)
    _draw_frame(sheet)
    sheet.text((left + 1.5, low + 1.6), "OFFICE 12")
    sheet.text((middle + 1.0, high - 1.2), "HALL")
    return Plan(np.array(sheet.image), walls, doors)


class _Pen:
    """Draw in metres, y up, at 1 cm a pixel."""

    def __init__(self) -> None:
        self.image = Image.new("L", (round(WIDE / SCALE), round(HIGH / SCALE)), 255)
        self.pen = ImageDraw.Draw(self.image)

    def px(self, point: Point) -> Point:
        return point[0] / SCALE, (HIGH - point[1]) / SCALE

    def line(self, a: Point, b: Point, *, width: int = 1, grey: int = 0) -> None:
        self.pen.line([self.px(a), self.px(b)], fill=grey, width=width)

    def path(self, points: list[Point], *, width: int = 1) -> None:
        for a, b in pairwise(points):
            self.line(a, b, width=width)

    def box(self, low: Point, high: Point, *, width: int = 1) -> None:
        self.path([low, (high[0], low[1]), high, (low[0], high[1]), low], width=width)

    def text(self, at: Point, words: str, *, size: int = 24) -> None:
        self.pen.text(self.px(at), words, fill=0, font=ImageFont.load_default(size=size))


def _draw_walls(
    sheet: _Pen,
    style: str,
    body: shapely.Geometry,
    walls: tuple[tuple[Point, Point, float], ...],
    doors: tuple[Line, ...],
) -> None:
    if style == "single-line":
        gaps = shapely.union_all([shapely.LineString(d).buffer(0.05, cap_style="flat") for d in doors])
        lines = shapely.MultiLineString([[a, b] for a, b, _ in walls]).difference(gaps)
        for part in shapely.get_parts(lines):
            sheet.path(list(part.coords), width=3)
        return
    for part in shapely.get_parts(body):
        for ring, inside in [(part.exterior, 0), *((r, 255) for r in part.interiors)]:
            if style == "filled":
                sheet.pen.polygon([sheet.px(p) for p in ring.coords], fill=inside)
            else:
                sheet.path(list(ring.coords), width=3)
    if style == "hatched":
        _hatch(sheet, body)


def _hatch(sheet: _Pen, body: shapely.Geometry) -> None:
    for c in np.arange(-HIGH, WIDE, 0.14):
        hatch = shapely.LineString([(c, 0.0), (c + HIGH, HIGH)]).intersection(body.buffer(-0.01))
        for part in shapely.get_parts(hatch):
            if part.length > 0:
                sheet.path(list(part.coords))


def _draw_doors(sheet: _Pen, doors: tuple[Line, ...]) -> None:
    for a, b in doors:
        size = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        start = np.arctan2(b[1] - a[1], b[0] - a[0])
        arc = [
            (a[0] + size * np.cos(t), a[1] + size * np.sin(t))
            for t in np.linspace(start, start + np.pi / 2, 24)
        ]
        sheet.path(arc)
        sheet.line(a, arc[-1])


def _draw_stair(sheet: _Pen, at: Point) -> None:
    for k in range(9):
        sheet.line((at[0] + 0.28 * k, at[1]), (at[0] + 0.28 * k, at[1] + 1.2))
    sheet.line((at[0], at[1]), (at[0] + 2.24, at[1]))
    sheet.line((at[0], at[1] + 1.2), (at[0] + 2.24, at[1] + 1.2))


def _draw_furniture(sheet: _Pen, at: Point) -> None:
    sheet.box(at, (at[0] + 1.6, at[1] + 0.8))
    sheet.box((at[0] + 0.5, at[1] + 0.95), (at[0] + 1.0, at[1] + 1.4))
    sheet.box((at[0] + 2.3, at[1]), (at[0] + 2.75, at[1] + 1.8))


def _draw_dimensions(sheet: _Pen, left: float, right: float, y: float) -> None:
    sheet.line((left - 0.2, y), (right + 0.2, y))
    for x in (left, right):
        sheet.line((x, y - 0.15), (x, y + 0.6))
        sheet.line((x - 0.1, y - 0.1), (x + 0.1, y + 0.1), width=2)
    sheet.text(((left + right) / 2, y + 0.35), f"{round(1000 * (right - left))}")


def _draw_axis(sheet: _Pen, x: float, low: float, high: float) -> None:
    y = low
    while y < high:
        sheet.line((x + 0.6, y), (x + 0.6, min(y + 0.6, high)))
        sheet.line((x + 0.6, y + 0.75), (x + 0.6, min(y + 0.83, high)))
        y += 0.98


def _draw_frame(sheet: _Pen) -> None:
    sheet.box((0.3, 0.3), (WIDE - 0.3, HIGH - 0.3), width=2)
    sheet.box((WIDE - 4.8, 0.3), (WIDE - 0.3, 1.3), width=2)
    sheet.text((WIDE - 4.6, 1.15), "FLOOR 1", size=20)
