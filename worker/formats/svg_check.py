"""A look at an SVG file before it is parsed: entities, size, nesting, and how much `use` multiplies."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import iterparse

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex, FileEmpty, FileMalformed, FileTruncated

_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_DEEPEST, _DEEPEST_CALL = 256, 400
_STROKES_SHARE, _ELEMENT = 4, 5
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[zZ]")
_ARCS = re.compile(r"[aA]([^aAcChHlLmMqQsStTvVzZ]*)")
_ARC = 4
_REMOTE = re.compile(r"@import|url\(\s*['\"]?(?:https?:|file:|//)", re.IGNORECASE)


@dataclass
class SvgFacts:
    """Hold what the look at an SVG file found.

    Parameters
    ----------
    root : dict of str to str
        Attributes of the outermost element.
    external : int
        References to other files or addresses; they are never followed.
    hidden : int
        Groups and shapes that are not displayed.
    """

    root: dict[str, str] = field(default_factory=dict)
    external: int = 0
    hidden: int = 0


def check_svg(path: Path, bounds: Bounds) -> SvgFacts:
    """Return the facts of an SVG file that can be parsed safely.

    Parameters
    ----------
    path : Path
        The file.
    bounds : Bounds
        `max_page_bytes` of the file; a quarter of `max_strokes` of its strokes, since each is an
        object; an element counts as five, and so does an arc beside its numbers, about.

    Returns
    -------
    SvgFacts
        Attributes of the root, references to elsewhere, hidden parts.

    Raises
    ------
    FileEmpty, FileTruncated, FileMalformed
        If it is no whole XML document, declares entities, or a `use` shows itself.
    DrawingTooComplex
        If it is larger, deeper or more multiplied than is read.
    """
    size = path.stat().st_size
    if size == 0:
        raise FileEmpty(f"{path.name} has no bytes; upload the drawing again.")
    if size > bounds.max_page_bytes:
        raise _too_complex(
            f"{path.name} has {size >> 20} MB of text, at most {bounds.max_page_bytes >> 20} MB are read"
        )
    most = bounds.max_strokes // _STROKES_SHARE
    root = _parsed(path, most)
    if root is None or not str(root.tag).endswith("svg"):
        raise FileMalformed(f"{path.name} is XML, but no SVG drawing; export the drawing anew.")
    facts = SvgFacts({str(k): str(v) for k, v in root.attrib.items()})
    for element in root.iter():
        _note(element, facts)
    _Weigher(root, most).check()
    return facts


def _parsed(path: Path, most: int) -> Element | None:
    root: Element | None = None
    try:
        for count, element in enumerate(_elements(path)):
            root = element if root is None else root
            if count > most // _ELEMENT:
                raise _too_complex(f"{path.name} has more than {most // _ELEMENT} elements")
    except DefusedXmlException as error:
        raise FileMalformed(
            f"{path.name} declares XML entities or refers to other documents, which are not read: "
            "save it as plain SVG."
        ) from error
    except ParseError as error:
        if "no element found" in str(error) or "unclosed" in str(error):
            raise FileTruncated(f"{path.name} ends within its drawing: {error}. Upload it again.") from error
        raise FileMalformed(f"{path.name} is no well-formed XML: {error}. Export it anew.") from error
    except (ValueError, LookupError) as error:
        raise FileMalformed(f"{path.name} cannot be decoded: {error}. Export it anew.") from error
    return root


def _elements(path: Path) -> Iterator[Element]:
    """Yield each element as it begins; the tree grows behind them, at most 256 deep."""
    depth = 0
    with path.open("rb") as file:
        for event, element in iterparse(file, events=("start", "end"), forbid_dtd=False):
            depth += 1 if event == "start" else -1
            if depth > _DEEPEST:
                raise _too_complex(f"{path.name} nests its elements deeper than {_DEEPEST} levels")
            if event == "start":
                yield element


def _too_complex(what: str) -> DrawingTooComplex:
    return DrawingTooComplex(
        f"{what}: too much to be read. Export only the floor that is needed, or a PNG image."
    )


def _note(element: Element, facts: SvgFacts) -> None:
    for name in _HREFS:
        target = element.get(name, "").strip()
        facts.external += bool(target) and not target.startswith(("#", "data:")) and _shows(element)
    style = element.get("style", "")
    text = element.text if str(element.tag).endswith("style") and element.text else style
    facts.external += bool(_REMOTE.search(text))
    shown = re.sub(r"\s", "", style)
    facts.hidden += element.get("display") == "none" or "display:none" in shown


def _shows(element: Element) -> bool:
    return str(element.tag).rsplit("}", 1)[-1] in {"use", "image", "feImage", "script", "pattern", "tref"}


class _Weigher:
    """Count the strokes that a drawing comes to once every `use` is followed."""

    def __init__(self, root: Element, most: int) -> None:
        self._root, self._most = root, most
        self._known: dict[Element, int] = {}
        self._open: set[Element] = set()
        self._ids = {name: e for e in root.iter() if (name := e.get("id"))}

    def check(self) -> None:
        self._weight(self._root, 0)

    def _weight(self, element: Element, depth: int) -> int:
        if element in self._known:
            return self._known[element]
        if element in self._open:
            raise FileMalformed("A `use` of the drawing shows itself; export the drawing anew.")
        if depth > _DEEPEST_CALL:
            raise _too_complex(f"Its `use` elements refer to each other more than {_DEEPEST_CALL} deep")
        self._open.add(element)
        total = _ELEMENT + _strokes(element)
        for part in self._parts(element):
            total += self._weight(part, depth + 1)
            if total > self._most:
                raise _too_complex(f"Its shapes and `use` elements come to more than {self._most} strokes")
        self._open.discard(element)
        self._known[element] = total
        return total

    def _parts(self, element: Element) -> Iterator[Element]:
        yield from element
        if str(element.tag).rsplit("}", 1)[-1] == "use":
            for name in _HREFS:
                target: Any = self._ids.get(element.get(name, "").strip().removeprefix("#"))
                if target is not None:
                    yield target


def _strokes(element: Element) -> int:
    """Return about how many segments a shape has: half its numbers, and more for each arc (of 7 numbers)."""
    shape = element.get("d") or element.get("points")
    if not shape:
        return 0
    arcs = sum(len(_NUMBER.findall(arc)) for arc in _ARCS.findall(shape)) // 7
    return len(_NUMBER.findall(shape)) // 2 + _ARC * arcs
