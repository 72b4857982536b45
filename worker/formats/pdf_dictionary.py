"""What a PDF's dictionaries say of a page that no renderer tells: units, layers, measures, weight."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pypdf import PdfReader
from pypdf.generic import ArrayObject, DictionaryObject, NameObject

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex, FileMalformed
from worker.formats.pdf_weight import check_weight

_DEEPEST, _MOST_KIDS, _MOST_ENTRIES = 64, 200_000, 10_000
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


def read_page_facts(source: Path | bytes, index: int, *, bounds: Bounds) -> PageFacts:
    """Return what the dictionaries of a PDF say of the page of this index, counted from 0.

    Its content is weighed first, so that a small file cannot make the renderer work for hours.

    Parameters
    ----------
    source : Path or bytes
        The document, not encrypted.
    index : int
        Page, counted from 0.
    bounds : Bounds
        The most that a page may come to.

    Returns
    -------
    PageFacts
        What is missing or unreadable keeps its default.

    Raises
    ------
    FileMalformed
        If the document's tables or its page tree cannot be followed.
    DrawingTooComplex
        If the page comes to more than is read.
    """
    try:
        with PdfReader(io.BytesIO(source) if isinstance(source, bytes) else source) as reader:
            root = reader.trailer["/Root"].get_object()
            page = _page(root, index)
            check_weight(page, bounds)
            return PageFacts(_user_unit(page), frozenset(_hidden(root)), tuple(_viewports(page)))
    except (DrawingTooComplex, MemoryError):
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
