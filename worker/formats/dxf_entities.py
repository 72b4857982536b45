"""One entity of a DXF file as polylines in its own space, with how it is drawn."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

import numpy as np
from ezdxf import colors, path
from ezdxf.entities.boundary_paths import EdgePath, SplineEdge
from ezdxf.entities.dxfentity import DXFEntity
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.mtext import MText
from ezdxf.entities.polygon import DXFPolygon
from ezdxf.entities.spline import Spline
from ezdxf.math import OCS, Vec3
from ezdxf.tools.text import fast_plain_mtext
from numpy.typing import NDArray

from worker.formats.dxf_bulges import FULL_CIRCLE, LEAST_CHORDS, bulged_path
from worker.formats.dxf_parts import BY_BLOCK, BY_LAYER, INHERIT_LAYER, Drawn, PartBuilder, Point, Style
from worker.geometry.drawing.linework.curves import Arc
from worker.geometry.drawing.linework.linework import Dimension
from worker.geometry.drawing.text import Text

IGNORED = frozenset({"VIEWPORT", "ATTDEF", "SEQEND", "POINT", "WIPEOUT", "LIGHT", "SUN", "VERTEX"})
"""Entities that draw nothing of a building, or nothing at all."""

_LETTER = 0.7
_LARGEST_TEXT, _LARGEST_PARAGRAPH = 500, 5_000
_MOST_LINES = 200
_PARAGRAPH = re.compile(r"(?<!\\)\\P")
_CURVE_SHARE, _CURVE_PIECES = 400.0, 4
_MOST_FITTED, _MOST_CONTROLS = 1_000, 2_000


def style_of(entity: DXFEntity, *, in_block: bool) -> Style:
    """Return how an entity says that it is drawn."""
    dxf = entity.dxf
    layer = str(dxf.get("layer", "0"))
    if in_block and layer == "0":
        layer = INHERIT_LAYER
    return Style(layer, _colour(dxf), _width(dxf.get("lineweight", -1)), _dashed(entity, dxf))


def colour_of_index(index: int) -> int:
    """Return 0xRRGGBB of one of AutoCAD's 255 colours; white on black is black on paper."""
    if index in {7, 255} or not 0 < index < 256:
        return 0
    r, g, b = colors.aci2rgb(index)
    return r << 16 | g << 8 | b


def width_of_weight(weight: int) -> float:
    """Return the width [mm] of a line weight in hundredths of a millimetre; NaN for the default."""
    return weight / 100.0 if weight >= 0 else math.nan


def _colour(dxf: object) -> int:
    get = dxf.get  # type: ignore[attr-defined]  # ezdxf's namespace of attributes
    true = get("true_color")
    if true is not None:
        return int(true) & 0xFFFFFF
    index = int(get("color", 256))
    if index == 256:
        return BY_LAYER
    return BY_BLOCK if index == 0 else colour_of_index(abs(index))


def _width(weight: int) -> float:
    return {-1: BY_LAYER, -2: BY_BLOCK}.get(int(weight), width_of_weight(int(weight)))


def _dashed(entity: DXFEntity, dxf: object) -> int:
    name = str(dxf.get("linetype", "BYLAYER")).upper()  # type: ignore[attr-defined]  # as in _colour
    if name in {"BYLAYER", "BYBLOCK"}:
        return BY_LAYER if name == "BYLAYER" else BY_BLOCK
    return int(has_gaps(entity.doc, name))


def has_gaps(doc: object, linetype: str) -> bool:
    """Return whether a line type of the document has gaps."""
    if linetype.upper() in {"CONTINUOUS", "BYLAYER", "BYBLOCK", ""} or doc is None:
        return False
    table = doc.linetypes  # type: ignore[attr-defined]  # ezdxf types the document loosely
    return linetype in table and len(table.get(linetype).simplified_line_pattern()) > 1


def add_entity(entity: DXFGraphic, style: Style, to: PartBuilder) -> bool:
    """Add an entity that is no reference; return whether its type is one that is read.

    Raises
    ------
    ValueError, TypeError, ArithmeticError, LookupError, AttributeError
        If the entity is malformed; the caller counts it.
    """
    add = _ADDERS.get(entity.dxftype())
    if add is None:
        return False
    add(entity, style, to)
    return True


def _line(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    a, b = entity.dxf.start, entity.dxf.end
    to.add([[(a.x, a.y), (b.x, b.y)]], Drawn("line", style))


@np.errstate(invalid="ignore", over="ignore")  # such places are told later
def _arc_points(arc: Arc) -> NDArray[np.float64]:
    x, y, radius, start, sweep = arc
    angles = start + sweep * np.linspace(0.0, 1.0, _chords(sweep) + 1)
    return np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])


def _chords(sweep: float) -> int:
    return max(LEAST_CHORDS, math.ceil(abs(sweep) / math.tau * FULL_CIRCLE))


def _arc(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    dxf = entity.dxf
    centre, radius = entity.ocs().to_wcs(dxf.center), float(dxf.radius)
    if entity.dxftype() == "CIRCLE":
        start, sweep = 0.0, math.tau
    else:
        start = math.radians(dxf.start_angle)
        sweep = math.radians((dxf.end_angle - dxf.start_angle) % 360.0) or math.tau
        if dxf.extrusion.z < 0:
            start, sweep = math.pi - start, -sweep
    if not (math.isfinite(start) and math.isfinite(sweep) and radius > 0):
        msg = "an arc without radius or angles"
        raise ValueError(msg)
    arc = (centre.x, centre.y, radius, start, sweep)
    full = abs(sweep) >= math.tau - 1e-9
    to.add([_arc_points(arc)], Drawn("circle" if full else "arc", style, closed=full))
    if not full:
        to.add_arcs(np.array([arc]))


def _lwpolyline(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    points = [(p[0], p[1], p[2]) for p in entity.get_points("xyb")]  # type: ignore[attr-defined]  # an LWPolyline
    closed = bool(entity.closed)  # type: ignore[attr-defined]  # an LWPolyline
    mirrored = entity.dxf.extrusion.z < 0
    _bulged(points, closed=closed, ocs=entity.ocs() if mirrored else None, style=style, to=to)


def _polyline(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    if not (entity.is_2d_polyline or entity.is_3d_polyline):  # type: ignore[attr-defined]  # a Polyline
        for face in entity.virtual_entities():  # type: ignore[attr-defined]  # a mesh of 3D faces
            _solid(face, style, to)
        return
    points = [
        (v.dxf.location.x, v.dxf.location.y, float(v.dxf.get("bulge", 0.0)))
        for v in entity.vertices  # type: ignore[attr-defined]  # a Polyline
        if not v.dxf.flags & 16
    ]
    mirrored = entity.is_2d_polyline and entity.dxf.extrusion.z < 0  # type: ignore[attr-defined]  # a Polyline
    _bulged(
        points,
        closed=bool(entity.is_closed),  # type: ignore[attr-defined]  # a Polyline
        ocs=entity.ocs() if mirrored else None,
        style=style,
        to=to,
    )


def _bulged(
    points: list[tuple[float, float, float]],
    *,
    closed: bool,
    ocs: OCS | None,
    style: Style,
    to: PartBuilder,
) -> None:
    """Add a polyline whose third numbers are bulges: tangents of a quarter of the arc's sweep."""
    if len(points) < 2:
        return
    closed = closed and len(points) > 2
    ring = [*points, points[0]] if closed else points
    out, arcs = bulged_path(np.array(ring, dtype=np.float64))
    if ocs is None:
        to.add_arcs(arcs)
    else:
        out = np.array([(w.x, w.y) for w in (ocs.to_wcs(Vec3(x, y)) for x, y in out.tolist())])
    shut = closed or (len(out) > 3 and bool((out[0] == out[-1]).all()))
    to.add([out], Drawn("line" if len(out) == 2 else "polyline", style, closed=shut))


def _spline(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    """Add a spline; of one with very many points these themselves: a curve fitted to N takes N^2 time."""
    assert isinstance(entity, Spline)
    for points, most in ((entity.control_points, _MOST_CONTROLS), (entity.fit_points, _MOST_FITTED)):
        if len(points) > most:
            to.add([[(float(p[0]), float(p[1])) for p in points]], Drawn("spline", style))
            return
        if len(points):
            break
    _curve(entity, style, to)


def _curve(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    made = path.make_path(entity)
    points = [(v.x, v.y) for v in _flat(made)]
    shut = len(points) > 3 and math.dist(points[0], points[-1]) < 1e-9
    to.add([points], Drawn(entity.dxftype().lower(), style, closed=shut))


def _flat(made: path.Path) -> list[Vec3]:
    control = made.control_vertices()
    if not control:
        return []
    size = max(
        max(v.x for v in control) - min(v.x for v in control),
        max(v.y for v in control) - min(v.y for v in control),
    )
    if not math.isfinite(size) or len(control) > 100_000:
        msg = "a curve without an end"
        raise ValueError(msg)
    return list(made.flattening(max(size / _CURVE_SHARE, 1e-9), _CURVE_PIECES))


def _hatch(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    rings = []
    assert isinstance(entity, DXFPolygon)
    _check_edges(entity)
    for made in path.from_hatch(entity):
        points = [(v.x, v.y) for v in _flat(made)]
        if len(points) > 2:
            rings.append(points if points[0] == points[-1] else [*points, points[0]])
    to.add(rings, Drawn("hatch", style, filled=bool(entity.dxf.get("solid_fill", 0)), closed=True))


def _check_edges(area: DXFPolygon) -> None:
    """Refuse an area whose outline is a curve of more points than can be followed."""
    edges = (edge for boundary in area.paths if isinstance(boundary, EdgePath) for edge in boundary.edges)
    for edge in edges:
        if isinstance(edge, SplineEdge) and (
            len(edge.fit_points) > _MOST_FITTED or len(edge.control_points) > _MOST_CONTROLS
        ):
            msg = f"a curve fitted to more than {_MOST_FITTED} points, or held by {_MOST_CONTROLS}"
            raise ValueError(msg)


def _solid(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    points = [(v.x, v.y) for v in entity.wcs_vertices()]  # type: ignore[attr-defined]  # a Solid or Face3d
    if len(points) > 2:
        filled = entity.dxftype() in {"SOLID", "TRACE"}
        to.add([[*points, points[0]]], Drawn("solid", style, filled=filled, closed=True))


def _several(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    """Add what an entity draws as simpler ones: a multiline, a table."""
    for part in entity.virtual_entities():  # type: ignore[attr-defined]  # such entities have it
        add_entity(part, style, to)


def _leader(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    points = [(v[0], v[1]) for v in entity.vertices]  # type: ignore[attr-defined]  # a Leader
    to.add([points], Drawn("leader", style))


def _text(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    dxf = entity.dxf
    said = entity.plain_text()  # type: ignore[attr-defined]  # a Text
    align = dxf.get("halign", 0)
    at = dxf.insert if align in {0, 3, 5} or not dxf.hasattr("align_point") else dxf.align_point
    angle, height = math.radians(dxf.get("rotation", 0.0)), float(dxf.get("height", 1.0))
    half = 0.5 * _LETTER * height * float(dxf.get("width", 1.0)) * len(said)
    along = {0: half, 3: half, 5: half, 2: -half}.get(align, 0.0)
    where = entity.ocs().to_wcs(at)
    _add_text(to, said, (where.x, where.y), height, angle, (along, 0.5 * height), style.layer)


def _mtext(entity: DXFGraphic, style: Style, to: PartBuilder) -> None:
    dxf = entity.dxf
    assert isinstance(entity, MText)
    lines = lines_of(entity.text)
    height = float(dxf.get("char_height", 1.0))
    angle = math.radians(entity.get_rotation())
    point = int(dxf.get("attachment_point", 1))
    column, row = (point - 1) % 3, (point - 1) // 3
    for n, line in enumerate(lines[:_MOST_LINES]):
        half = 0.5 * _LETTER * height * len(line)
        up = (-0.5 - 1.6 * n) * height + row * 0.5 * (1.6 * len(lines) - 0.6) * height
        _add_text(
            to, line, (dxf.insert.x, dxf.insert.y), height, angle, ((1 - column) * half, up), style.layer
        )


def lines_of(text: str) -> list[str]:
    """Return the lines of a formatted text without its codes, each paragraph by itself.

    ezdxf copies what is left of a text for each of its codes: that takes the square of its length.
    """
    paragraphs = _PARAGRAPH.split(text)
    shown = (fast_plain_mtext(part[:_LARGEST_PARAGRAPH], split=True) for part in paragraphs[:_MOST_LINES])
    lines = [line for part in shown for line in part]
    return lines + [""] * (len(paragraphs) - _MOST_LINES)


def _add_text(
    to: PartBuilder,
    said: str,
    at: Point,
    height: float,
    angle: float,
    offset: tuple[float, float],
    layer: str,
) -> None:
    said = said.strip()[:_LARGEST_TEXT]
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = at[0] + offset[0] * cos - offset[1] * sin, at[1] + offset[0] * sin + offset[1] * cos
    if said and math.isfinite(x + y + height + angle):
        to.texts.append(Text(said, x, y, height, angle, layer))


def dimension_of(entity: DXFGraphic) -> Dimension | None:
    """Return what a linear dimension measures, or None for an angle, a radius or an ordinate.

    Raises
    ------
    ValueError, TypeError, ArithmeticError, LookupError, AttributeError
        If the entity is malformed; the caller counts it.
    """
    dxf = entity.dxf
    if int(dxf.get("dimtype", 0)) & 7 > 1 or not (dxf.hasattr("defpoint2") and dxf.hasattr("defpoint3")):
        return None
    length = entity.get_measurement()  # type: ignore[attr-defined]  # a Dimension
    if not isinstance(length, float) or not (math.isfinite(length) and length > 0):
        return None
    shown = str(dxf.get("text", "")).strip()
    a, b = dxf.defpoint2, dxf.defpoint3
    shown = "" if "<>" in shown else shown
    return Dimension((a.x, a.y), (b.x, b.y), length, shown, str(dxf.get("layer", "0")))


_ADDERS: Mapping[str, Callable[[DXFGraphic, Style, PartBuilder], None]] = {
    "LINE": _line,
    "ARC": _arc,
    "CIRCLE": _arc,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "ELLIPSE": _curve,
    "SPLINE": _spline,
    "HELIX": _spline,
    "HATCH": _hatch,
    "MPOLYGON": _hatch,
    "SOLID": _solid,
    "TRACE": _solid,
    "3DFACE": _solid,
    "MLINE": _several,
    "LEADER": _leader,
    "TEXT": _text,
    "ATTRIB": _text,
    "MTEXT": _mtext,
}
