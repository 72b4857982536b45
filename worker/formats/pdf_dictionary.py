"""What a PDF's dictionaries say of a page that no renderer tells: units, layers, measures, weight."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pypdf import PdfReader
from pypdf.generic import ArrayObject, DictionaryObject, NameObject, StreamObject

from service.domain.errors import DrawingTooComplex, FileMalformed

_DO = re.compile(rb"/([^\s/<>\[\](){}%]+)\s+Do\b")
_CALL_WEIGHT = 256
_DEEPEST, _MOST_KIDS, _MOST_ENTRIES = 64, 200_000, 10_000
_DEEPEST_FORM = 40
_CHUNK = 1 << 20
_UNITS = {
    "mm": 0.001, "millimeter": 0.001, "millimetre": 0.001, "cm": 0.01, "centimeter": 0.01, "centimetre": 0.01,
    "m": 1.0, "meter": 1.0, "metre": 1.0, "km": 1000.0,
    "in": 0.0254, "inch": 0.0254, '"': 0.0254, "\u2033": 0.0254, "ft": 0.3048, "foot": 0.3048, "feet": 0.3048,
    "'": 0.3048, "\u2032": 0.3048, "yd": 0.9144, "yard": 0.9144, "pt": 0.0254 / 72, "point": 0.0254 / 72,
}  # fmt: skip


@dataclass(frozen=True)
class Viewport:
    """Hold a measuring viewport of a page (ISO 32000-1, 12.9).

    Parameters
    ----------
    box : tuple of float
        Left, bottom, right, top in the page's user space.
    metres_per_point : float
        Real metres a unit of user space.
    ratio : str
        The scale as the file writes it, such as ``1 in = 8 ft``.
    """

    box: tuple[float, float, float, float]
    metres_per_point: float
    ratio: str

    @property
    def area(self) -> float:
        """Return the area in user space."""
        return abs((self.box[2] - self.box[0]) * (self.box[3] - self.box[1]))


@dataclass(frozen=True)
class PageFacts:
    """Hold what the dictionaries say of one page.

    Parameters
    ----------
    user_unit : float
        Points (1/72 inch) in a unit of user space.
    hidden_layers : frozenset of str
        Names of the optional-content layers that are off when the file opens.
    viewports : tuple of Viewport
        Measuring viewports.
    """

    user_unit: float = 1.0
    hidden_layers: frozenset[str] = frozenset()
    viewports: tuple[Viewport, ...] = ()


def read_page_facts(source: Path | bytes, index: int, *, most_bytes: int) -> PageFacts:
    """Return what the dictionaries of a PDF say of the page of this index, counted from 0.

    Its content is weighed first: every stream as long as it unpacks, every form as often as it is called,
    so that a small file cannot make the renderer work for hours.

    Parameters
    ----------
    source : Path or bytes
        The document, not encrypted.
    index : int
        Page, counted from 0.
    most_bytes : int
        The most content that a page may have.

    Returns
    -------
    PageFacts
        What is missing or unreadable keeps its default.

    Raises
    ------
    FileMalformed
        If the document's tables or its page tree cannot be followed.
    DrawingTooComplex
        If the page's content is larger than `most_bytes`.
    """
    try:
        with PdfReader(io.BytesIO(source) if isinstance(source, bytes) else source) as reader:
            root = reader.trailer["/Root"].get_object()
            page = _page(root, index)
            _weigh(page, most_bytes)
            return PageFacts(_user_unit(page), frozenset(_hidden(root)), tuple(_viewports(page)))
    except DrawingTooComplex:
        raise
    except Exception as error:
        raise FileMalformed(f"The document's tables cannot be followed: {error}. Save it anew.") from error


def _page(root: Any, index: int) -> DictionaryObject:
    """Return the dictionary of a page with the resources that it inherits."""
    node = root["/Pages"].get_object()
    resources = None
    for _ in range(_DEEPEST):
        resources = node.get("/Resources", resources)
        if "/Kids" not in node:
            if "/Type" not in node:
                msg = "the page has no readable dictionary"
                raise ValueError(msg)
            page = DictionaryObject(node)
            if resources is not None:
                page[NameObject("/Resources")] = resources
            return page
        node, index = _kid(node, index)
    msg = "the page tree is too deep"
    raise ValueError(msg)


def _kid(node: Any, index: int) -> tuple[Any, int]:
    kids = node["/Kids"].get_object()
    if len(kids) == int(node["/Count"]):
        return kids[index].get_object(), 0
    for kid in kids[:_MOST_KIDS]:
        found = kid.get_object()
        held = int(found.get("/Count", 1)) if "/Kids" in found else 1
        if index < held:
            return found, index
        index -= held
    msg = "the page tree ends early"
    raise ValueError(msg)


def _user_unit(page: DictionaryObject) -> float:
    unit = float(page.get("/UserUnit", 1.0))
    return unit if 1e-3 <= unit <= 1e4 else 1.0


def _hidden(root: Any) -> Iterator[str]:
    """Yield the names of the layers that are off in the default configuration."""
    properties = _dictionary(root.get("/OCProperties"))
    default = _dictionary(properties.get("/D"))
    off = default.get("/OFF", ArrayObject()).get_object()
    if default.get("/BaseState") == "/OFF":
        on = {_key(x) for x in default.get("/ON", ArrayObject()).get_object()[:_MOST_ENTRIES]}
        groups = properties.get("/OCGs", ArrayObject()).get_object()
        off = [x for x in groups[:_MOST_ENTRIES] if _key(x) not in on]
    for layer in off[:_MOST_ENTRIES]:
        yield str(_dictionary(layer).get("/Name", ""))


def _key(reference: Any) -> int:
    return int(getattr(reference, "idnum", 0))


def _dictionary(value: Any) -> Any:
    found = value.get_object() if value is not None else None
    return found if isinstance(found, DictionaryObject) else DictionaryObject()


def _viewports(page: DictionaryObject) -> Iterator[Viewport]:
    for entry in page.get("/VP", ArrayObject()).get_object()[:_MOST_ENTRIES]:
        viewport = _dictionary(entry)
        measure = _dictionary(viewport.get("/Measure"))
        box = [float(x) for x in viewport.get("/BBox", ArrayObject()).get_object()[:4]]
        size = _metres_per_point(measure)
        if size is not None and len(box) == 4:
            yield Viewport((box[0], box[1], box[2], box[3]), size, str(measure.get("/R", "")))


def _metres_per_point(measure: Any) -> float | None:
    """Return the size of a unit of user space by a rectilinear measure dictionary [m], or None."""
    if measure.get("/Subtype", "/RL") != "/RL" or "/X" not in measure:
        return None
    across = _dictionary(measure["/X"].get_object()[0])
    value = float(across.get("/C", 0.0))
    unit = _unit(across)
    distance = measure.get("/D")
    if unit is None and distance is not None and len(distance.get_object()):
        along = _dictionary(distance.get_object()[0])
        value, unit = value * float(along.get("/C", 1.0)), _unit(along)
    if unit is None or not 1e-9 < value * unit < 1e6:
        return None
    return value * unit


def _unit(entry: Any) -> float | None:
    name = str(entry.get("/U", "")).strip().lower().rstrip(".")
    return _UNITS.get(name, _UNITS.get(name.removesuffix("s")))


@dataclass
class _Weigher:
    """Sum what a page makes the renderer parse, form by form."""

    most: int
    known: dict[int, int] = field(default_factory=dict)

    def check(self, weight: int) -> int:
        if weight > self.most:
            raise DrawingTooComplex(
                f"The page unpacks to more than {self.most >> 20} MB of drawing commands; export only the "
                "floor that is needed, or print the sheet as a PNG image.",
                max_page_bytes=self.most,
            )
        return weight

    def content(self, content: bytes, resources: Any, depth: int) -> int:
        forms = _dictionary(resources.get("/XObject")) if resources else DictionaryObject()
        total = self.check(len(content))
        for name in _DO.findall(content):
            form = forms.get("/" + name.decode("latin-1"))
            total = self.check(total + _CALL_WEIGHT + self.form(form, resources, depth + 1))
        return total

    def form(self, reference: Any, inherited: Any, depth: int) -> int:
        found = reference.get_object() if reference is not None else None
        if not isinstance(found, StreamObject) or found.get("/Subtype") != "/Form" or depth > _DEEPEST_FORM:
            return 0
        key = id(found)
        if key not in self.known:
            self.known[key] = 0  # a form that calls itself is drawn once
            resources = _dictionary(found.get("/Resources")) or inherited
            self.known[key] = self.content(unpacked(found, most=self.most), resources, depth)
        return self.known[key]


def _weigh(page: DictionaryObject, most: int) -> int:
    weigher = _Weigher(most)
    contents = page.get("/Contents")
    found = contents.get_object() if contents is not None else ArrayObject()
    streams = found if isinstance(found, ArrayObject) else ArrayObject([found])
    whole = bytearray()
    for stream in streams[:_MOST_KIDS]:
        whole += unpacked(stream.get_object(), most=most)
        weigher.check(len(whole))
    return weigher.content(bytes(whole), _dictionary(page.get("/Resources")), 0)


def unpacked(stream: object, *, most: int) -> bytes:
    """Return a stream's content, of which at most `most` bytes and one more are unpacked.

    Parameters
    ----------
    stream : StreamObject
        Of a page or a form; any other object is empty.
    most : int
        Where unpacking stops.

    Returns
    -------
    bytes
        Longer than `most` where there would have been more.
    """
    if not isinstance(stream, StreamObject):
        return b""
    filters = stream.get("/Filter", ArrayObject()).get_object()
    names = [str(x) for x in filters] if isinstance(filters, ArrayObject) else [str(filters)]
    raw: bytes = stream._data  # noqa: SLF001 -- the packed bytes have no public name
    if not names:
        return raw[: most + 1]
    if names not in (["/FlateDecode"], ["/Fl"]):
        return stream.get_data()[: most + 1]
    out = bytearray()
    inflater = zlib.decompressobj()
    pending = raw
    try:
        while pending and len(out) <= most and not inflater.eof:
            out += inflater.decompress(pending, _CHUNK)
            pending = inflater.unconsumed_tail
    except zlib.error:
        return bytes(out)
    return bytes(out)
