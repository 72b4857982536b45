"""How much a PDF page makes its renderer parse, counted before the renderer sees it."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from pypdf.generic import ArrayObject, DictionaryObject, StreamObject

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex

LETTERS_PER_TEXT = 20
"""A page has at most so many letters for each text that is read."""

_REGULAR = rb"[^\0\s/<>\[\](){}%]"
_ALONE = rb"(?<!" + _REGULAR + rb"[\s\S])"  # behind one letter: nothing but a delimiter stands before it
_END = rb"(?!" + _REGULAR + rb")"
_SPACE = rb"(?:[\0\s]|%[^\r\n]*[\r\n])+"
_CALL = re.compile(rb"[DgsST]" + _ALONE + rb"(?:o|s|cn|CN|f)" + _END)
_OPERAND = re.compile(rb"/(" + _REGULAR + rb"*)" + _SPACE + rb"(?:[-+.\d]+" + _SPACE + rb")?\Z")
_LONGEST_OPERAND = 512
_PAINTED = re.compile(rb"[SsfFBbnDET'\"]" + _ALONE + rb"(?:\*|h|o|I|j|J|DC)?" + _END)
_STRING = re.compile(rb"\((?:[^()\\]++|\\.)*+\)|<[0-9A-Fa-f\0\s]++>", re.DOTALL)
_STATE = re.compile(rb"[qQ]" + _ALONE + _END)
_ESCAPED = re.compile(rb"#([0-9A-Fa-f]{2})")
_CATEGORIES = {b"Do": "/XObject", b"gs": "/ExtGState", b"scn": "/Pattern", b"SCN": "/Pattern", b"Tf": "/Font"}
_CALL_BYTES = 256
_DEEPEST = 40
_DEEPEST_STATE, _STATES_PER_OBJECT = 10_000, 4
_MOST_STREAMS = 200_000
_CHUNK = 1 << 20

Weight = tuple[int, int, int]
"""Bytes of drawing commands, objects and letters."""


def check_weight(page: DictionaryObject, bounds: Bounds) -> None:
    """Refuse a page that comes to more drawing commands, objects or letters than are read.

    Every stream counts as long as it unpacks, every form, pattern, mask and letter of a Type 3 font as often
    as it is called, to the depth of 40 to which the renderer follows: a form that draws itself twice is 2^40
    forms.

    Parameters
    ----------
    page : DictionaryObject
        With the resources that it inherits.
    bounds : Bounds
        `max_page_bytes`, `max_page_objects`, and `max_texts`.

    Raises
    ------
    DrawingTooComplex
        If it comes to more.

    Notes
    -----
    Names are looked up as pdfium does (ISO 32000-1, 7.8.3): in the form's own resources, then the page's. An
    operand that is no name, which pdfium takes all the same, counts as the heaviest thing that could be
    meant.
    """
    _Weigher(page, bounds).check()


@dataclass(eq=False)
class _Content:
    """Hold what one stream draws itself, and what it calls by category and name, how often."""

    own: Weight
    calls: Counter[tuple[str, str | None]] = field(default_factory=Counter)


@dataclass(frozen=True, eq=False)
class _Node:
    """Hold a stream with the resources that its names are looked up in."""

    content: _Content
    resources: Any


class _Weigher:
    def __init__(self, page: DictionaryObject, bounds: Bounds) -> None:
        self._page = _dictionary(page.get("/Resources"))
        self._bounds = bounds
        self._most = (
            bounds.max_page_bytes,
            bounds.max_page_objects,
            LETTERS_PER_TEXT * bounds.max_texts,
        )
        self._contents: dict[int, _Content] = {}
        self._nodes: dict[tuple[int, int], _Node] = {}
        self._weight = cache(self._weigh)
        self._root = _Node(self._parse(self._streams(page)), self._page)

    def check(self) -> None:
        self._weight(self._root, 0)

    def _streams(self, page: DictionaryObject) -> bytes:
        contents = page.get("/Contents")
        found = contents.get_object() if contents is not None else ArrayObject()
        whole = bytearray()
        for stream in (found if isinstance(found, ArrayObject) else [found])[:_MOST_STREAMS]:
            whole += unpacked(stream.get_object(), most=self._most[0]) + b"\n"
            self._check((len(whole), 0, 0))
        return bytes(whole)

    def _check(self, weight: Weight) -> Weight:
        """Refuse what is too much."""
        size, objects, letters = weight
        if size > self._most[0]:
            raise DrawingTooComplex(
                f"The page unpacks to more than {self._most[0] >> 20} MB of drawing commands; export only "
                "the floor that is needed, or print the sheet as a PNG image.",
                max_page_bytes=self._most[0],
            )
        if objects > self._most[1]:
            raise DrawingTooComplex(
                f"The page holds more than {self._most[1]} objects; export only the floor that is needed, or "
                "print the sheet as a PNG image.",
                max_page_objects=self._most[1],
            )
        if letters > self._most[2]:
            raise DrawingTooComplex(
                f"The page holds more than {self._most[2]} letters. Upload the sheet with the floor plan "
                "alone.",
                max_letters=self._most[2],
            )
        return weight

    def _parse(self, content: bytes) -> _Content:
        """Return what a stream draws and calls; counting stops where it is too much already."""
        objects = letters = 0
        for objects, _ in enumerate(_PAINTED.finditer(content), 1):
            if objects > self._most[1]:
                break
        if len(content) > self._most[2]:
            for found in _STRING.finditer(content):
                letters += found.end() - found.start() - 2
                if letters > self._most[2]:
                    break
        self._check_states(content)
        parsed = _Content(self._check((len(content), objects, letters)))
        for found in _CALL.finditer(content):
            if found[0] in _CATEGORIES:
                parsed.calls[_CATEGORIES[found[0]], _operand(content, found.start())] += 1
        return parsed

    def _check_states(self, content: bytes) -> None:
        """Refuse graphics states that are kept in each other without end: the renderer copies each."""
        depth = 0
        for count, found in enumerate(
            _STATE.finditer(content) if content.count(b"q") > _DEEPEST_STATE else ()
        ):
            depth = depth + 1 if found[0] == b"q" else max(depth - 1, 0)
            if depth > _DEEPEST_STATE or count > _STATES_PER_OBJECT * self._most[1]:
                raise DrawingTooComplex(
                    f"The page keeps more than {_DEEPEST_STATE} graphics states in each other, or "
                    f"{_STATES_PER_OBJECT * self._most[1]} in all; print the sheet as a PNG image.",
                    max_graphics_states=_DEEPEST_STATE,
                )

    def _weigh(self, node: _Node, depth: int) -> Weight:
        """Return the weight of a stream with all that it calls."""
        total = node.content.own
        if depth >= _DEEPEST:
            return total
        for (category, name), times in node.content.calls.items():
            size, objects, letters = self._called(node, category, name, depth + 1)
            total = (
                total[0] + times * (_CALL_BYTES + size),
                total[1] + times * objects,
                total[2] + times * letters,
            )
            self._check(total)
        return total

    def _called(self, node: _Node, category: str, name: str | None, depth: int) -> Weight:
        """Return the weight of what a name means; of the heaviest there is, where there is no name."""
        known = _dictionary(node.resources.get(category)) or _dictionary(self._page.get(category))
        meant = list(known.values()) if name is None else [known.get(name)]
        heaviest = (0, 0, 0)
        for value in meant:
            weights = [self._weight(inner, depth) for inner in self._drawn(value, category, node.resources)]
            heaviest = max(heaviest, _summed(weights))
        return heaviest

    def _drawn(self, value: Any, category: str, inherited: Any) -> Iterator[_Node]:
        """Yield the streams that are drawn for a form, a graphics state, a pattern or a font."""
        found = value.get_object() if value is not None else None
        if category == "/ExtGState":
            found = _dictionary(_dictionary(found).get("/SMask")).get("/G")
            found = found.get_object() if found is not None else None
        if category == "/Font":
            letters = _dictionary(_dictionary(found).get("/CharProcs"))
            inherited = _dictionary(_dictionary(found).get("/Resources")) or self._page
            for letter in list(letters.values()):
                yield from self._node(letter.get_object(), inherited)
        elif not (category == "/XObject" and _dictionary(found).get("/Subtype") == "/Image"):
            yield from self._node(found, inherited)

    def _node(self, stream: Any, inherited: Any) -> Iterator[_Node]:
        if not isinstance(stream, StreamObject):
            return
        resources = _dictionary(stream.get("/Resources")) or inherited
        key = (id(stream), id(resources))
        if key not in self._nodes:
            if id(stream) not in self._contents:
                self._contents[id(stream)] = self._parse(unpacked(stream, most=self._most[0]))
            self._nodes[key] = _Node(self._contents[id(stream)], resources)
        yield self._nodes[key]


def _summed(weights: list[Weight]) -> Weight:
    return sum(w[0] for w in weights), sum(w[1] for w in weights), sum(w[2] for w in weights)


def _dictionary(value: Any) -> Any:
    found = value.get_object() if value is not None else None
    return found if isinstance(found, DictionaryObject) else DictionaryObject()


def _operand(content: bytes, end: int) -> str | None:
    """Return the name that stands before an operator; None where something else does."""
    start = content.rfind(b"/", max(0, end - _LONGEST_OPERAND), end)
    match = _OPERAND.match(content, start, end) if start >= 0 else None
    return None if match is None else "/" + _ESCAPED.sub(_unescaped, match[1]).decode("latin-1")


def _unescaped(match: re.Match[bytes]) -> bytes:
    return bytes([int(match[1], 16)])


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
    if any(name not in {"/FlateDecode", "/Fl"} for name in names):
        return stream.get_data()[: most + 1]
    for _ in names:
        raw = _inflated(raw, most=most)
    return raw


def _inflated(raw: bytes, *, most: int) -> bytes:
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
