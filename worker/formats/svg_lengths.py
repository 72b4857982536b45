"""Lengths of an SVG file that count in letters or in the viewport, as plain numbers of its pixels."""

from __future__ import annotations

import re
from collections.abc import Callable
from xml.etree.ElementTree import Element, tostring

from defusedxml.ElementTree import fromstring

_DEFAULT = 16.0
"""Size of letters where nothing says one [px]: that of every browser."""

_OF_LETTERS = {"em": 1.0, "ex": 0.5, "ch": 0.5, "ic": 1.0, "lh": 1.2, "cap": 0.7}
_OF_ROOT = {"rem": 1.0, "rlh": 1.2}
_OF_VIEW = {"vw": (1, 0), "vh": (0, 1), "vi": (1, 0), "vb": (0, 1)}
_OF_EITHER = {"vmin": min, "vmax": max}
_ABSOLUTE = {
    "": 1.0,
    "px": 1.0,
    "in": 96.0,
    "cm": 96 / 2.54,
    "mm": 96 / 25.4,
    "pt": 96 / 72,
    "pc": 16.0,
    "q": 96 / 101.6,
}
_UNITS = "|".join((*_OF_LETTERS, *_OF_ROOT, *_OF_VIEW, *_OF_EITHER))
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RELATIVE = re.compile(rf"(?<![\w#.-])({_NUMBER})\s*({_UNITS})(?![\w-])", re.IGNORECASE)
_MAY_BE = re.compile(rf"\d\s*(?:{_UNITS})[\s\"';,)]".encode(), re.IGNORECASE)
_LENGTH = re.compile(rf"\s*({_NUMBER})\s*([a-zA-Z%]*)\s*$")
_FONT_SIZE = re.compile(r"(?:^|;)\s*font-size\s*:\s*([^;!]+)", re.IGNORECASE)
_UNTOUCHED = frozenset({"d", "points", "id", "class", "href"})


def with_plain_lengths(content: bytes, *, view: tuple[float, float]) -> bytes:
    """Return an SVG document without lengths in em, ex, rem, vw and the like; itself where it has none.

    Parameters
    ----------
    content : bytes
        A document that `check_svg` has let through.
    view : tuple of float
        Width and height of the viewport, in its unit.

    Notes
    -----
    CSS Values and Units 4, section 6: letters have the size that the element or the nearest one around it
    states; an ex or a ch is half of it. Rules of a style sheet count in the root's letters.
    """
    if not _MAY_BE.search(content):
        return content
    root = fromstring(content, forbid_dtd=False)
    size = _letters(root, _DEFAULT, _DEFAULT)
    stack = [(root, size)]
    while stack:
        element, letters = stack.pop()
        _make_plain(element, letters, _plain(letters, size, view))
        if element.text and str(element.tag).endswith("style"):
            element.text = _RELATIVE.sub(_plain(size, size, view), element.text)
        stack += [(child, _letters(child, letters, size)) for child in element]
    return tostring(root)


def pixels(value: object) -> float:
    """Return a length without a relative unit in pixels; 0 where it is none."""
    match = _LENGTH.match(str(value))
    return float(match[1]) * _ABSOLUTE.get(match[2].lower(), 0.0) if match else 0.0


def _make_plain(element: Element, letters: float, plain: Callable[[re.Match[str]], str]) -> None:
    """Replace the lengths of an element's attributes; its own size of letters counts in those around it."""
    if "font-size" in element.attrib:
        element.set("font-size", f"{letters:.9g}")
    if "style" in element.attrib:
        element.set("style", _FONT_SIZE.sub(f";font-size:{letters:.9g}px", element.attrib["style"]))
    for name, value in element.attrib.items():
        if name.rpartition("}")[2] not in _UNTOUCHED:
            element.set(name, _RELATIVE.sub(plain, value))


def _plain(letters: float, root: float, view: tuple[float, float]) -> Callable[[re.Match[str]], str]:
    def replaced(match: re.Match[str]) -> str:
        return f"{float(match[1]) * _unit(match[2].lower(), letters, root, view):.9g}"

    return replaced


def _unit(name: str, letters: float, root: float, view: tuple[float, float]) -> float:
    """Return how many pixels a unit is."""
    if name in _OF_LETTERS:
        return _OF_LETTERS[name] * letters
    if name in _OF_ROOT:
        return _OF_ROOT[name] * root
    if name in _OF_VIEW:
        return (view[0] * _OF_VIEW[name][0] + view[1] * _OF_VIEW[name][1]) / 100.0
    return _OF_EITHER[name](view) / 100.0


def _letters(element: Element, inherited: float, root: float) -> float:
    """Return the size of an element's letters [px]."""
    styled = _FONT_SIZE.search(element.get("style", ""))
    match = _LENGTH.match(styled[1] if styled else element.get("font-size", ""))
    if match is None:
        return inherited
    number, unit = float(match[1]), match[2].lower()
    if unit == "%":
        return number / 100.0 * inherited
    if unit in _ABSOLUTE:
        return number * _ABSOLUTE[unit]
    return (
        number * _unit(unit, inherited, root, (0.0, 0.0)) if unit in {*_OF_LETTERS, *_OF_ROOT} else inherited
    )
