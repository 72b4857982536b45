"""A floor plan as vector pages in several hands: outlined, filled, with layers, with clutter around it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.formats.linework_draft import LineworkDraft, Pen
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.reading.reading import Reading
from worker.geometry.drawing.text import Text

PAGE = (0.0, 0.0, 420.0, 297.0)
CORNER = (60.0, 70.0)
OUTER, INNER = 0.3, 0.12


@dataclass(frozen=True)
class Plan:
    """Hold the material of walls [m, from the plan's corner] and doors as hinge, width, direction [rad]."""

    material: Any
    doors: tuple[tuple[float, float, float, float], ...]


def a_plan(seed: int) -> Plan:
    """Return a plan of two rows of rooms along a corridor, random within limits."""
    random = np.random.default_rng(seed)
    wide, high = random.uniform(18, 26), random.uniform(11, 14)
    mid = high / 2
    walls = [
        shapely.box(0, 0, wide, high) - shapely.box(OUTER, OUTER, wide - OUTER, high - OUTER),
        shapely.box(OUTER, mid - 1.0 - INNER, wide - OUTER, mid - 1.0),
        shapely.box(OUTER, mid + 1.0, wide - OUTER, mid + 1.0 + INNER),
    ]
    gaps, doors = [], []
    for low, face in ((OUTER, mid - 1.0 - INNER), (mid + 1.0 + INNER, high - OUTER)):
        edges = [0.3, *np.cumsum(random.uniform(3.2, 5.5, size=3)), wide - 0.3]
        walls += [shapely.box(x, low, x + INNER, face) for x in edges[1:-1]]
        door_y = face if low == OUTER else low - INNER
        for a, b in itertools.pairwise(edges):
            x = random.uniform(a + 0.6, max(a + 0.7, b - 1.8))
            gaps.append(shapely.box(x, door_y, x + 0.9, door_y + INNER))
            doors.append((x, door_y, 0.9, math.pi / 2))
    material = shapely.union_all(walls) - shapely.union_all(gaps)
    for x in (wide * 0.3, wide * 0.6):
        material = material - shapely.box(x, 0, x + 1.5, OUTER)
    return Plan(material, tuple(doors))


def a_page(plan: Plan, ratio: float, *, style: str, pens: tuple[float, float] = (0.5, 0.18)) -> Linework:
    """Return an A3 page [mm] of a plan at 1:`ratio`, with furniture, tiles, doors, texts, frame and table.

    `style` is ``outlined``, ``filled``, ``compound`` (one filled area with holes), or ``masked`` (white
    windows laid over filled walls).
    """
    draft = LineworkDraft(PAGE, most=500_000)
    mm = 1000.0 / ratio
    heavy, thin = Pen(width=pens[0]), Pen(width=pens[1])

    def at(points: Any) -> list[tuple[float, float]]:
        return [(CORNER[0] + x * mm, CORNER[1] + y * mm) for x, y in points]

    _clutter(draft, at, plan, thin)
    for body in shapely.get_parts(plan.material):
        _draw_body(draft, at, body, (style, heavy))
    if style == "masked":
        for window in _windows(plan):
            draft.add(at(window.exterior.coords[:-1]), pen=Pen(colour=0xFFFFFF, filled=True), closed=True)
    doors = [(CORNER[0] + x * mm, CORNER[1] + y * mm, w * mm, 0.0, turn) for x, y, w, turn in plan.doors]
    for arc in doors:
        draft.add_arc(arc)
    texts = (
        Text(f"SCALE 1:{ratio:g}", 380.0, 12.0, 3.0),
        *(Text(f"{100 + i}", *_room(CORNER, d, mm), 2.5) for i, d in enumerate(plan.doors)),
    )
    return replace(draft.finish(page_mm_per_unit=1.0), texts=texts)


def _draw_body(draft: LineworkDraft, at: Any, body: Any, hand: tuple[str, Pen]) -> None:
    style, heavy = hand
    black = Pen(colour=0x505050, filled=True)
    if style in {"filled", "masked"}:
        for piece in shapely.get_parts(shapely.constrained_delaunay_triangles(body)):
            draft.add(at(piece.exterior.coords[:-1]), pen=black, closed=True)
        return
    for i, ring in enumerate([body.exterior, *body.interiors]):
        pen = heavy if style == "outlined" else black
        draft.add(at(ring.coords[:-1]), pen=pen, closed=True, again=pen.filled and i > 0)


def _windows(plan: Plan) -> list[Any]:
    x0, _, x1, y1 = plan.material.bounds
    return [shapely.box(x, y1 - OUTER, x + 1.2, y1) for x in (x0 + 0.2 * (x1 - x0), x0 + 0.7 * (x1 - x0))]


def _room(
    corner: tuple[float, float], door: tuple[float, float, float, float], mm: float
) -> tuple[float, float]:
    up = 1.9 if door[1] > 6 else -1.9
    return corner[0] + (door[0] + 0.4) * mm, corner[1] + (door[1] + up) * mm


def _clutter(draft: LineworkDraft, at: Any, plan: Plan, thin: Pen) -> None:
    """Draw what is no wall: frame, title block, tiles, furniture, door leaves and swings, a box of text."""
    left, bottom, right, top = PAGE
    for inset in (8.0, 10.0):
        frame = [(left + inset, bottom + inset), (right - inset, bottom + inset)]
        frame += [(right - inset, top - inset), (left + inset, top - inset)]
        draft.add(frame, pen=Pen(width=0.5), closed=True)
    for y in (12.0, 18.0, 24.0, 30.0):
        draft.add([(300.0, y), (410.0, y)], pen=thin)
    x0, y0, _, y1 = plan.material.bounds
    for x in np.arange(x0 + 0.5, x0 + 2.6, 0.3):
        draft.add(at([(x, y0 + 0.5), (x, y0 + 2.5)]), pen=thin)
    for y in np.arange(y0 + 0.5, y0 + 2.6, 0.3):
        draft.add(at([(x0 + 0.5, y), (x0 + 2.5, y)]), pen=thin)
    for x, y, wide, _ in plan.doors:
        leaf = [(x, y), (x, y + wide), (x + 0.04, y + wide), (x + 0.04, y)]
        draft.add(at(leaf), pen=thin, closed=True)
        angle = np.linspace(0, math.pi / 2, 13)
        swing = [(x + wide * math.cos(a), y + wide * math.sin(a)) for a in angle]
        draft.add(at(swing), pen=thin, kind="arc")
        desk = [
            (x + 0.2, y1 / 2 + 0.3),
            (x + 1.6, y1 / 2 + 0.3),
            (x + 1.6, y1 / 2 + 0.9),
            (x + 0.2, y1 / 2 + 0.9),
        ]
        draft.add(at(desk), pen=thin, closed=True)


def faces_of(reading: Reading) -> NDArray[np.float64]:
    """Return points every 5 cm along the faces of a reading's walls and its columns [m]."""
    lines = [f for w in reading.walls for f in w.faces]
    lines += [np.vstack([c.outline, c.outline[:1]]) for c in reading.columns]
    return _sampled([shapely.linestrings(line) for line in lines])


def truth_of(plan: Plan, ratio: float) -> tuple[Any, NDArray[np.float64]]:
    """Return the outline of the material in frame `drawing` [m], and points every 5 cm along it."""
    scale = ratio / 1000.0
    outline = shapely.affinity.translate(plan.material, CORNER[0] * scale, CORNER[1] * scale).boundary
    return outline, _sampled(list(shapely.get_parts(outline)))


def _sampled(lines: list[Any]) -> NDArray[np.float64]:
    points = [
        shapely.get_coordinates(shapely.line_interpolate_point(x, np.arange(0.025, x.length, 0.05)))
        for x in lines
    ]
    return np.vstack(points) if points else np.zeros((0, 2))


def agreement(reading: Reading, plan: Plan, ratio: float, *, within: float = 0.02) -> tuple[float, float]:
    """Return precision and recall of a reading's faces against the plan's outline."""
    outline, truth = truth_of(plan, ratio)
    found = faces_of(reading)
    lines = [f for w in reading.walls for f in w.faces]
    lines += [np.vstack([c.outline, c.outline[:1]]) for c in reading.columns]
    drawn = shapely.multilinestrings([shapely.linestrings(x) for x in lines])
    shapely.prepare(drawn)
    shapely.prepare(outline)
    precision = float(shapely.dwithin(shapely.points(found), outline, within).mean()) if len(found) else 0.0
    recall = float(shapely.dwithin(shapely.points(truth), drawn, within).mean())
    return precision, recall
