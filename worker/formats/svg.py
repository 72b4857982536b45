"""SVG drawings to linework: units, transforms, groups as layers, strokes, fills, dashes and texts."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import svgelements

from service.domain.bounds import Bounds
from service.domain.errors import FileMalformed
from service.domain.findings import Finding
from worker.formats.linework_draft import LineworkDraft, Pen
from worker.formats.svg_check import SvgFacts, check_svg
from worker.formats.svg_lengths import pixels, with_plain_lengths
from worker.formats.text_runs import TextRun, join_runs
from worker.geometry.drawing.linework.curves import Point, flatten_cubic
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.text import Text

_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Z%]*)\s*$")
_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "q": 0.25, "m": 1000.0}
_NUMBERED = re.compile(
    r"(?:g|path|rect|use|svg|layer|group|shape|surface|id|_)?[-_]?\d+(?:[-_]\d+)*$", re.IGNORECASE
)
_LARGEST_SIDE = 1e6
_CSS_PPI = 96.0
_TOLERANCE_SHARE = 5e-5
_LETTER_WIDTH = 0.55
_ARC_STEP = math.radians(5.0)


def load_svg(path: Path, *, bounds: Bounds | None = None) -> Linework:
    """Return the strokes and texts of an SVG drawing.

    Parameters
    ----------
    path : Path
        The file.
    bounds : Bounds, optional
        `max_page_bytes`, `max_strokes` (a quarter of them), `max_texts`.

    Returns
    -------
    Linework
        x right, y up, origin at the viewport's lower left; in millimetres of paper where the file states its
        width in mm, cm, in or pt, else in its own pixels.

    Raises
    ------
    FileEmpty, FileTruncated, FileMalformed
        If it is no whole SVG document, declares entities, or a `use` shows itself.
    DrawingTooComplex
        If it holds more than is read.

    Notes
    -----
    The document is looked through by defusedxml and counted with every `use` followed, before svgelements
    unfolds it. Nothing outside the file is ever opened.
    """
    bounds = bounds or Bounds()
    facts = check_svg(path, bounds)
    viewport = _viewport(facts.root, path)
    drawing = _parsed(path, viewport)
    draft = LineworkDraft((0.0, 0.0, viewport.width, viewport.height), most=bounds.max_strokes)
    texts = _collect(drawing, draft, viewport, most_texts=bounds.max_texts)
    linework = draft.finish(page_mm_per_unit=viewport.mm_per_unit)
    return replace(linework, texts=texts, findings=(*linework.findings, *_findings(facts)))


@dataclass(frozen=True)
class _Viewport:
    """Hold the size of the drawing in its unit, and millimetres of paper in one where they are known."""

    width: float
    height: float
    mm_per_unit: float | None

    @property
    def tolerance(self) -> float:
        return max(self.width, self.height) * _TOLERANCE_SHARE


def _viewport(root: dict[str, str], path: Path) -> _Viewport:
    box = [
        float(x) for x in re.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?", root.get("viewBox", ""))
    ]
    sides = [_LENGTH.match(root.get(name, "")) for name in ("width", "height")]
    units = [m.group(2).lower() if m else "%" for m in sides]
    values = [float(m.group(1)) if m else 0.0 for m in sides]
    if all(u in _MM for u in units):
        mm: float | None = 1.0 if len(box) == 4 else 25.4 / _CSS_PPI
        width, height = (v * _MM[u] / (mm or 1.0) for v, u in zip(values, units, strict=True))
    elif all(u in {"", "px"} for u in units):
        (width, height), mm = values, None
    elif len(box) == 4:
        (width, height), mm = box[2:], None
    else:
        raise FileMalformed(f"{path.name} states neither its size nor a viewBox; export it with a page size.")
    if not (0 < width <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE):
        raise FileMalformed(
            f"{path.name} states a size of {width:g} x {height:g}; it has to be positive and below "
            f"{_LARGEST_SIDE:g}. Export it on a real sheet."
        )
    return _Viewport(width, height, mm)


def _parsed(path: Path, viewport: _Viewport) -> Any:
    """Return svgelements' document with every transform applied, in the viewport's unit."""
    ppi = 25.4 if viewport.mm_per_unit == 1.0 else _CSS_PPI
    try:
        drawing = svgelements.SVG.parse(
            io.BytesIO(with_plain_lengths(path.read_bytes(), view=(viewport.width, viewport.height))),
            reify=True,
            ppi=ppi,
            width=viewport.width,
            height=viewport.height,
        )
    except Exception as error:
        raise FileMalformed(f"{path.name} cannot be unfolded: {error}. Export it anew.") from error
    if not isinstance(drawing, list):
        raise FileMalformed(f"{path.name} holds no drawing of the SVG namespace; export it anew.")
    return drawing


def _collect(drawing: Any, draft: LineworkDraft, viewport: _Viewport, *, most_texts: int) -> tuple[Text, ...]:
    runs: list[TextRun] = []
    for shape, layer in _shapes(drawing):
        if isinstance(shape, svgelements.Text):
            if len(runs) < most_texts:
                runs += _runs(shape, viewport, layer)
        elif isinstance(shape, svgelements.Shape):
            _add(shape, draft, viewport, layer)
    return join_runs(runs)


def _shapes(drawing: Any) -> Iterator[tuple[Any, str]]:
    """Yield every shape with the name of its layer: the nearest group's label, id or class."""
    stack = [(iter(drawing), "")]
    while stack:
        children, layer = stack[-1]
        child = next(children, None)
        if child is None:
            stack.pop()
        elif isinstance(child, list):
            stack.append((iter(child), _name(child) or layer))
        else:
            yield child, layer or _name(child)


def _name(element: Any) -> str:
    own = (element.values or {}).get("attributes", {})
    if own.get(_LABEL):
        return str(own[_LABEL])
    name = str(own.get("id") or "")
    if name and not _NUMBERED.match(name):
        return name
    return str(own.get("class") or "")


def _add(shape: Any, draft: LineworkDraft, viewport: _Viewport, layer: str) -> None:
    if str((shape.values or {}).get("visibility", "")) in {"hidden", "collapse"}:
        return
    stroke = _colour(shape.stroke)
    fill = None if isinstance(shape, svgelements.SimpleLine) else _colour(shape.fill)
    width = pixels(shape.stroke_width) * (viewport.mm_per_unit or math.nan)
    dashes = str((shape.values or {}).get("stroke-dasharray", "none"))
    dashed = stroke is not None and bool(re.search(r"[1-9]", dashes))
    line = None if stroke is None else Pen(layer, width, stroke, dashed=dashed)
    body = None if fill is None else Pen(layer, math.nan, fill, filled=True)
    subpaths = list(_subpaths(shape, viewport))
    filled = 0
    for points, closed, _ in subpaths if body is not None else ():
        if body is not None and len(points) > 2:
            pen = body if line is None or body.is_white else replace(body, width=width, dashed=dashed)
            draft.add(points, pen=pen, closed=closed, again=filled > 0)
            filled += 1
    for points, closed, arcs in subpaths if line is not None else ():
        kind = "" if not arcs else "arc" if len(arcs) == 1 else "spline"
        if line is not None and (body is None or body.is_white or not filled):
            draft.add(points, pen=line, kind=kind, closed=closed)
        for arc in arcs:
            draft.add_arc(arc)


def _colour(colour: Any) -> int | None:
    """Return 0xRRGGBB, or None for none and for what is wholly transparent."""
    if colour is None or colour.value is None or not colour.alpha:
        return None
    return int(colour.red) << 16 | int(colour.green) << 8 | int(colour.blue)


def _subpaths(shape: Any, viewport: _Viewport) -> Iterator[tuple[list[Point], bool, list[Any]]]:
    """Yield each subpath as points with y up, whether it is closed, and its circular arcs."""
    points: list[Point] = []
    arcs: list[Any] = []
    for segment in shape.segments():
        if isinstance(segment, svgelements.Move):
            if len(points) > 1:
                yield points, False, arcs
            points, arcs = [_up(segment.end, viewport)], []
        elif isinstance(segment, svgelements.Close):
            if len(points) > 1:
                yield points, True, arcs
            points, arcs = points[:1], []
        elif isinstance(segment, svgelements.Line):
            points.append(_up(segment.end, viewport))
        else:
            points += _curve(segment, viewport)
            if isinstance(segment, svgelements.Arc):
                _join(arcs, segment, viewport)
    if len(points) > 1:
        yield points, False, arcs


def _up(point: Any, viewport: _Viewport) -> Point:
    return (math.nan, math.nan) if point is None else (float(point.x), viewport.height - float(point.y))


def _curve(segment: Any, viewport: _Viewport) -> list[Point]:
    if isinstance(segment, svgelements.Arc):
        count = min(max(2, math.ceil(abs(float(segment.sweep)) / _ARC_STEP)), 144)
        places = np.asarray(segment.npoint([i / count for i in range(1, count + 1)]), dtype=np.float64)
        return [(x, viewport.height - y) for x, y in places.tolist()]
    if isinstance(segment, svgelements.QuadraticBezier):
        a, b, c = (_up(p, viewport) for p in (segment.start, segment.control, segment.end))
        first = (a[0] + 2 / 3 * (b[0] - a[0]), a[1] + 2 / 3 * (b[1] - a[1]))
        second = (c[0] + 2 / 3 * (b[0] - c[0]), c[1] + 2 / 3 * (b[1] - c[1]))
        curve = [a, first, second, c]
    else:
        controls = (segment.start, segment.control1, segment.control2, segment.end)
        curve = [_up(p, viewport) for p in controls]
    return flatten_cubic(curve, tolerance=viewport.tolerance)


def _join(arcs: list[Any], segment: Any, viewport: _Viewport) -> None:
    """Add a circular arc, or lengthen the last where it goes on around the same centre."""
    radius = float(segment.rx)
    if not (radius > 0 and abs(float(segment.ry) - radius) <= 1e-3 * radius):
        return
    x, y = _up(segment.center, viewport)
    start = _up(segment.start, viewport)
    arc = (x, y, radius, math.atan2(start[1] - y, start[0] - x), -float(segment.sweep))
    if not np.isfinite(arc).all():
        return
    last = arcs[-1] if arcs else None
    near = 1e-3 * radius
    if last is not None and math.dist(last[:3], arc[:3]) <= near and last[4] * arc[4] > 0:
        arcs[-1] = (*last[:4], last[4] + arc[4])
    else:
        arcs.append(arc)


def _runs(shape: Any, viewport: _Viewport, layer: str) -> Iterator[TextRun]:
    words = " ".join(str(shape.text or "").split())
    m = shape.transform
    size = pixels(shape.font_size) * math.hypot(m.c, m.d)
    angle = math.atan2(-m.b, m.a)
    x, y = pixels(shape.x), pixels(shape.y)
    begin = (m.a * x + m.c * y + m.e, viewport.height - (m.b * x + m.d * y + m.f))
    if not (words and size > 0 and np.isfinite([*begin, size, angle]).all()):
        return
    length = _LETTER_WIDTH * size * len(words)
    back = {"middle": 0.5, "end": 1.0}.get(str((shape.values or {}).get("text-anchor", "")), 0.0) * length
    yield TextRun(
        words,
        begin[0] - back * math.cos(angle),
        begin[1] - back * math.sin(angle),
        length,
        size,
        angle,
        layer,
    )


def _findings(facts: SvgFacts) -> Iterator[Finding]:
    if facts.external:
        yield Finding(
            "external-reference",
            "warning",
            f"{facts.external} parts of the drawing lie in other files or at web addresses; they are never "
            "opened. Embed them before exporting if walls are missing.",
            {"references": facts.external},
        )
    if facts.hidden:
        yield Finding(
            "layer-hidden",
            "info",
            f"{facts.hidden} groups or shapes are not displayed in the drawing and were passed over.",
            {"objects": facts.hidden},
        )
