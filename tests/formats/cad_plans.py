"""CAD plans that tests write themselves: two rooms with doors, their layers, blocks and dimensions."""

from __future__ import annotations

import itertools
from pathlib import Path

import ezdxf.filemanagement
from ezdxf.document import Drawing

OUTER, INNER = 0.3, 0.1
"""Thickness of the outer walls and of the partition [m]."""


def new_drawing(insunits: int = 4) -> Drawing:
    """Return an empty drawing whose header says a unit (4 is millimetres)."""
    doc = ezdxf.filemanagement.new("R2010")
    doc.header["$INSUNITS"] = insunits
    return doc


def face_lines(u: float = 1.0, *, x: float = 0.0, y: float = 0.0) -> list[tuple[tuple[float, float], ...]]:
    """Return the wall lines of a 20 x 12 m building with two rooms, `u` units a metre: open at two doors."""
    outline = [(0, 0), (20, 0), (20, 12), (0, 12)]
    left = [(0.3, 0.3), (9.9, 0.3), (9.9, 5.0), (10.0, 5.0), (10.0, 0.3), (19.7, 0.3), (19.7, 11.7)]
    left += [(10.0, 11.7), (10.0, 5.9), (9.9, 5.9), (9.9, 11.7), (0.3, 11.7)]
    rings = [[*outline, outline[0]], [*left, left[0]]]
    lines = [pair for ring in rings for pair in itertools.pairwise(ring)]
    return [tuple(((px + x) * u, (py + y) * u) for px, py in pair) for pair in lines]


def draw_plan(doc: Drawing, u: float = 1.0, *, layer: str = "A-WALL", x: float = 0.0, y: float = 0.0) -> None:
    """Draw walls, three doors with their swings, a table, a dimension and a text, `u` units a metre."""
    model = doc.modelspace()
    for start, end in face_lines(u, x=x, y=y):
        model.add_line(start, end, dxfattribs={"layer": layer})
    for dx, dy in ((9.95, 5.0), (3.0, 0.15), (14.0, 0.15)):
        hinge = ((dx + x) * u, (dy + y) * u)
        model.add_arc(hinge, 0.9 * u, 0, 90, dxfattribs={"layer": "A-DOOR"})
        model.add_line(hinge, (hinge[0], hinge[1] + 0.9 * u), dxfattribs={"layer": "A-DOOR"})
    table = [(2, 2), (4, 2), (4, 3), (2, 3)]
    model.add_lwpolyline(
        [((a + x) * u, (b + y) * u) for a, b in table], close=True, dxfattribs={"layer": "FURN"}
    )
    model.add_text("OFFICE", height=0.3 * u, dxfattribs={"layer": "A-ANNO-TEXT"}).set_placement(
        ((5 + x) * u, (6 + y) * u)
    )


def saved(doc: Drawing, path: Path) -> Path:
    """Save a drawing as ASCII DXF and return where."""
    doc.saveas(path)
    return path
