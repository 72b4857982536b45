"""The objects of a PDF page as pdfium parses them: strokes to linework, and how far images cover the page."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Iterator
from ctypes import byref
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pypdfium2.raw as pdfium
from numpy.typing import NDArray

from service.domain.errors import DrawingTooComplex
from worker.formats.linework_draft import Box, LineworkDraft, Pen
from worker.geometry.drawing.linework.curves import Arc, Point, arc_of, flatten_cubic

Affine = tuple[float, float, float, float, float, float]
"""a, b, c, d, e, f: (x, y) goes to (a x + c y + e, b x + d y + f), as in PDF."""

_TOLERANCE = 0.05
_DEEPEST = 40
_MOST_CLIP_PATHS = 8
_MOST_CLIP_POINTS = 12
_COVER_CELLS = 64
_SAME_CIRCLE = 0.01
_TELL_EVERY = 5_000
_LARGE_IMAGE = 0.02


def compose(first: Affine, then: Affine) -> Affine:
    """Return the map that takes a point through `first` and `then`."""
    a, b, c, d, e, f = first
    A, B, C, D, E, F = then
    return (A * a + C * b, B * a + D * b, A * c + C * d, B * c + D * d, A * e + C * f + E, B * e + D * f + F)


def moved(m: Affine, x: float, y: float) -> Point:
    """Return the point where the map takes (x, y)."""
    return (m[0] * x + m[2] * y + m[4], m[1] * x + m[3] * y + m[5])


@dataclass
class PageImage:
    """Hold an image on a page: the box that it covers [mm] and its pixels an inch.

    `item` is pdfium's own, of the open page.
    """

    box: Box
    dpi: float
    item: Any


@dataclass
class PageObjects:
    """Hold what the walk over a page's objects found beside its strokes.

    Parameters
    ----------
    images : list of PageImage
        Every image on a layer that is shown.
    hidden : dict of str to int
        How many objects of each hidden layer were passed over.
    text_layers : dict of int to str
        The layer of each text object on a named layer, by the object's address; hidden ones too.
    """

    images: list[PageImage] = field(default_factory=list)
    hidden: dict[str, int] = field(default_factory=dict)
    text_layers: dict[int, str] = field(default_factory=dict)

    def image_cover(self, page: Box) -> float:
        """Return the share of the page that images cover together."""
        cells = np.zeros((_COVER_CELLS, _COVER_CELLS), dtype=np.bool_)
        wide, high = page[2] - page[0], page[3] - page[1]
        for image in self.images:
            left, bottom, right, top = image.box
            columns = _cells((left - page[0]) / wide, (right - page[0]) / wide)
            rows = _cells((bottom - page[1]) / high, (top - page[1]) / high)
            cells[rows, columns] = True
        return float(cells.mean())


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])


def _cells(low: float, high: float) -> slice:
    edge = np.clip(np.array([low, high]) * _COVER_CELLS, 0, _COVER_CELLS)
    return slice(round(float(edge[0])), round(float(edge[1])))


class PageWalk:
    """Walk over the objects of a page, into its forms, and collect strokes in a draft.

    Parameters
    ----------
    draft : LineworkDraft
        Takes the strokes [mm of paper, as displayed].
    hidden_layers : frozenset of str
        Layers that are passed over.
    most : int
        Objects that are visited at most.
    tell : callable
        Called now and then with the number of objects visited; what it raises ends the walk.
    """

    def __init__(
        self, draft: LineworkDraft, *, hidden_layers: frozenset[str], most: int, tell: Callable[[int], None]
    ) -> None:
        self.found = PageObjects()
        self._draft = draft
        self._hidden = hidden_layers
        self._left = most
        self._most = most
        self._tell = tell
        self._x, self._y = ctypes.c_float(), ctypes.c_float()
        self._page: Any = None
        self._matrix = pdfium.FS_MATRIX()
        self._rgba = tuple(ctypes.c_uint() for _ in range(4))
        self._text = (ctypes.c_ushort * 512)()

    def page(self, page: Any, T_mm_user: Affine) -> None:
        """Collect the strokes of a page; `T_mm_user` takes its user space to the displayed frame [mm]."""
        self._page = page
        count = self._room_for(pdfium.FPDFPage_CountObjects(page))
        found = (pdfium.FPDFPage_GetObject(page, i) for i in range(count))
        self._container(found, T_mm_user, clip=self._draft.page, layer="", depth=0)

    def _container(self, objects: Iterator[Any], T: Affine, *, clip: Box, layer: str, depth: int) -> None:
        for item in objects:
            self._count()
            name = self._layer(item) or layer
            kind = pdfium.FPDFPageObj_GetType(item)
            if name and kind == pdfium.FPDF_PAGEOBJ_TEXT:
                self.found.text_layers[ctypes.cast(item, ctypes.c_void_p).value or 0] = name
            if name in self._hidden:
                self.found.hidden[name] = self.found.hidden.get(name, 0) + 1
                continue
            if kind == pdfium.FPDF_PAGEOBJ_PATH:
                self._path(item, T, clip=self._clip(item, T, clip), layer=name)
            elif kind == pdfium.FPDF_PAGEOBJ_FORM and depth < _DEEPEST:
                count = self._room_for(pdfium.FPDFFormObj_CountObjects(item))
                inner = (pdfium.FPDFFormObj_GetObject(item, i) for i in range(count))
                window = self._clip(item, T, clip)
                self._container(inner, compose(self._own(item), T), clip=window, layer=name, depth=depth + 1)
            elif kind == pdfium.FPDF_PAGEOBJ_IMAGE:
                self._image(item, T, clip=self._clip(item, T, clip))

    def _room_for(self, count: int) -> int:
        """Return the number of objects that come next, unless these are too many."""
        if count > self._left:
            raise DrawingTooComplex(
                f"The page holds more than {self._most} objects; export only the floor that is needed, or "
                "print the sheet as a PNG image.",
                max_page_objects=self._most,
            )
        return count

    def _count(self) -> None:
        self._left -= 1
        self._room_for(0)
        if self._left % _TELL_EVERY == 0:
            self._tell(self._most - self._left)

    def _own(self, item: Any) -> Affine:
        m = self._matrix
        pdfium.FPDFPageObj_GetMatrix(item, byref(m))
        return (m.a, m.b, m.c, m.d, m.e, m.f)

    def _layer(self, item: Any) -> str:
        """Return the optional-content layer that the object is marked with, or nothing."""
        for i in range(pdfium.FPDFPageObj_CountMarks(item)):
            mark = pdfium.FPDFPageObj_GetMark(item, i)
            if self._string(pdfium.FPDFPageObjMark_GetName, mark) == "OC":
                name = self._string(pdfium.FPDFPageObjMark_GetParamStringValue, mark, b"Name")
                if name:
                    return name
        return ""

    def _string(self, function: Any, *arguments: Any) -> str:
        length = ctypes.c_ulong()
        if not function(*arguments, self._text, ctypes.sizeof(self._text), byref(length)):
            return ""
        size = min(length.value, ctypes.sizeof(self._text))
        return bytes(self._text)[:size].decode("utf-16-le", "replace").rstrip("\0")

    def _clip(self, item: Any, T: Affine, outer: Box) -> Box:
        """Return the window through which the object is seen, as the box around its clipping paths."""
        path = pdfium.FPDFPageObj_GetClipPath(item)
        count = pdfium.FPDFClipPath_CountPaths(path) if path else 0
        left, bottom, right, top = outer
        for i in range(max(0, min(count, _MOST_CLIP_PATHS))):
            size = pdfium.FPDFClipPath_CountPathSegments(path, i)
            if not 0 < size <= _MOST_CLIP_POINTS:
                continue
            points = []
            for j in range(size):
                segment = pdfium.FPDFClipPath_GetPathSegment(path, i, j)
                pdfium.FPDFPathSegment_GetPoint(segment, byref(self._x), byref(self._y))
                points.append(moved(T, self._x.value, self._y.value))
            xs, ys = zip(*points, strict=True)
            left, bottom = max(left, min(xs)), max(bottom, min(ys))
            right, top = min(right, max(xs)), min(top, max(ys))
        return (left, bottom, right, top)

    def _colour(self, function: Any, item: Any) -> int | None:
        """Return the colour as 0xRRGGBB, or None where it is wholly transparent."""
        r, g, b, a = self._rgba
        if not function(item, byref(r), byref(g), byref(b), byref(a)):
            return 0
        return r.value << 16 | g.value << 8 | b.value if a.value else None

    def _path(self, item: Any, T: Affine, *, clip: Box, layer: str) -> None:
        if clip[0] >= clip[2] or clip[1] >= clip[3]:
            return
        fill, stroked = ctypes.c_int(), ctypes.c_int()
        pdfium.FPDFPath_GetDrawMode(item, byref(fill), byref(stroked))
        stroke = self._colour(pdfium.FPDFPageObj_GetStrokeColor, item) if stroked.value else None
        body = self._colour(pdfium.FPDFPageObj_GetFillColor, item) if fill.value else None
        T_mm_item = compose(self._own(item), T)
        width = ctypes.c_float()
        pdfium.FPDFPageObj_GetStrokeWidth(item, byref(width))
        mm = width.value * math.sqrt(abs(T_mm_item[0] * T_mm_item[3] - T_mm_item[1] * T_mm_item[2]))
        dashed = stroke is not None and pdfium.FPDFPageObj_GetDashCount(item) > 0
        pens = []
        if body is not None:
            pens.append(Pen(layer, math.nan, body, filled=True))
        if stroke is not None:
            pens.append(Pen(layer, round(mm, 4), stroke, dashed=dashed))
        if not pens:
            return
        if len(pens) == 2 and not pens[0].is_white:
            pens = [Pen(layer, pens[1].width, pens[0].colour, dashed=dashed, filled=True)]
        self._draft.expect(pdfium.FPDFPath_CountSegments(item))
        subpaths = list(self._subpaths(item, T_mm_item))
        for pen in pens:
            before = len(self._draft)
            for points, closed, kind, _ in subpaths:
                again = pen.filled and len(self._draft) > before
                drawn_as = "" if pen.filled else kind
                self._draft.add(points, pen=pen, kind=drawn_as, closed=closed, clip=clip, again=again)
        for *_, arcs in subpaths if stroke is not None else ():
            for arc in arcs:
                self._draft.add_arc(arc)

    def _subpaths(self, item: Any, T: Affine) -> Iterator[tuple[list[Point], bool, str, list[Arc]]]:
        """Yield each subpath: its points [mm], whether it is closed, its kind, and its circular arcs."""
        points: list[Point] = []
        pending: list[Point] = []
        curves: list[NDArray[np.float64]] = []
        for i in range(pdfium.FPDFPath_CountSegments(item)):
            segment = pdfium.FPDFPath_GetPathSegment(item, i)
            kind = pdfium.FPDFPathSegment_GetType(segment)
            pdfium.FPDFPathSegment_GetPoint(segment, byref(self._x), byref(self._y))
            point = moved(T, self._x.value, self._y.value)
            if kind == pdfium.FPDF_SEGMENT_MOVETO:
                if len(points) > 1:
                    yield points, False, *_curved(points, curves)
                points, pending, curves = [point], [], []
            elif kind == pdfium.FPDF_SEGMENT_LINETO:
                points.append(point)
            else:
                pending.append(point)
                if len(pending) == 3 and points:
                    piece = [points[-1], *pending]
                    curves.append(np.array(piece))
                    points += flatten_cubic(piece, tolerance=_TOLERANCE)
                    pending = []
            if pdfium.FPDFPathSegment_GetClose(segment) and len(points) > 1:
                yield points, True, *_curved(points, curves)
                points, curves = [points[0]], []
        if len(points) > 1:
            yield points, False, *_curved(points, curves)

    def _image(self, item: Any, T: Affine, *, clip: Box) -> None:
        m = compose(self._own(item), T)
        corners = [moved(m, x, y) for x, y in ((0, 0), (1, 0), (0, 1), (1, 1))]
        xs, ys = zip(*corners, strict=True)
        box = (max(min(xs), clip[0]), max(min(ys), clip[1]), min(max(xs), clip[2]), min(max(ys), clip[3]))
        wide, high = ctypes.c_uint(), ctypes.c_uint()
        pdfium.FPDFImageObj_GetImagePixelSize(item, byref(wide), byref(high))
        across = math.hypot(m[0], m[1])
        if not (box[0] < box[2] and box[1] < box[3] and across > 0):
            return
        self.found.images.append(PageImage(box, wide.value * 25.4 / across, item))


def _curved(points: list[Point], curves: list[NDArray[np.float64]]) -> tuple[str, list[Arc]]:
    """Return the kind of a subpath, and the circular arcs among its curves, neighbours joined."""
    arcs: list[Arc] = []
    joined = None
    for curve in curves:
        arc = arc_of(_sampled(curve))
        last = arcs[-1] if arcs else None
        if arc is None:
            joined = None
            continue
        if last is not None and joined is not None and _same_circle(last, arc) and (joined == curve[0]).all():
            arcs[-1] = (*last[:4], last[4] + arc[4])
        else:
            arcs.append(arc)
        joined = curve[3]
    if not curves:
        return "", []
    if len(arcs) == 1 and len(points) > 2:
        whole = abs(abs(arcs[0][4]) - 2 * math.pi) < _SAME_CIRCLE
        return "circle" if whole else "arc", arcs
    return "spline", arcs


def _sampled(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    t = np.linspace(0.0, 1.0, 9)[:, None]
    s = 1.0 - t
    points = s**3 * curve[0] + 3 * s * s * t * curve[1] + 3 * s * t * t * curve[2] + t**3 * curve[3]
    return np.asarray(points, dtype=np.float64)


def _same_circle(a: Arc, b: Arc) -> bool:
    off = math.hypot(a[0] - b[0], a[1] - b[1]) + abs(a[2] - b[2])
    return off <= _SAME_CIRCLE * a[2] and a[4] * b[4] > 0
