"""What a dimension text says: a number with its unit, or the units that it may be in."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

Form = Literal["integer", "metres", "feet", "stated"]

_FOOT, _INCH = 0.3048, 0.0254
_STATED = {"mm": 0.001, "cm": 0.01, "m": 1.0}
_MOST_METRES = 400.0
_MOST_TEXT = 24
_QUOTES = str.maketrans(
    {
        **dict.fromkeys("\u2019\u2018\u2032`\u00b4", "'"),
        **dict.fromkeys("\u201c\u201d\u2033\u3003", '"'),
        **dict.fromkeys("\u2014\u2013\u2212\u4e00_", "-"),
        "\u3002": ".",
    }
)
_DIGITS = str.maketrans({"O": "0", "o": "0", "\u3007": "0", "I": "1", "l": "1", "|": "1"})
_FRACTION = r"(?P<over>\d{1,2})/(?P<under>2|4|8|16|32|64)"
_FEET = re.compile(
    rf"^(?P<feet>\d{{1,4}})'[- ]*(?:(?P<inch>\d{{1,2}})?[- ]*(?:{_FRACTION})?\s*(?:\"|''?)?)?$"
)
_INCHES = re.compile(rf"^(?P<inch>\d{{1,3}})?[- ]*(?:{_FRACTION})?\s*(?:\"|'')$")
_WITH_UNIT = re.compile(r"^(?P<number>\d[\d., ]*)\s*(?P<unit>mm|cm|m)$", re.IGNORECASE)
_INTEGER = re.compile(r"^\d{2,6}$")
_THOUSANDS = re.compile(r"^\d{1,3}[ ,.]\d{3}$")
_DECIMAL = re.compile(r"^\d{1,3}[.,]\d{1,3}$")


@dataclass(frozen=True)
class Measure:
    """Hold the length that a text names.

    Parameters
    ----------
    value : float
        In metres; for the form `integer` the bare number, whose unit the text does not say.
    form : str
        ``integer`` (millimetres or centimetres), ``metres`` (a decimal number), ``feet`` (feet and inches),
        ``stated`` (the unit is written).
    """

    value: float
    form: Form


def plain(text: str) -> str:
    """Return a text with the quotes, dashes and wide characters of all alphabets as plain ones."""
    return unicodedata.normalize("NFKC", text.translate(_QUOTES)).strip()


def parse_measure(text: str) -> Measure | None:
    r"""Return the length that a text names by itself, or None where it is no length.

    Millimetres, centimetres and metres with comma or point, thousands set apart, feet and inches with
    fractions. Levels (``+3.20``), areas, angles, diameters, counts and room numbers with letters are none.

    Examples
    --------
    >>> parse_measure("20089")
    Measure(value=20089.0, form='integer')
    >>> parse_measure("3,60")
    Measure(value=3.6, form='metres')
    >>> parse_measure("12'-6\"")
    Measure(value=3.81, form='feet')
    """
    text = plain(text)
    if not 0 < len(text) <= _MOST_TEXT:
        return None
    found = _imperial(text) or _metric(text)
    if found is None or not found.value > 0:
        return None
    if found.form != "integer" and found.value > _MOST_METRES:
        return None
    return found


def _imperial(text: str) -> Measure | None:
    for pattern in (_FEET, _INCHES):
        match = pattern.match(text)
        if match is None:
            continue
        parts = match.groupdict()
        inches = float(parts["inch"] or 0)
        if parts["over"]:
            if int(parts["over"]) >= int(parts["under"]):
                return None
            inches += int(parts["over"]) / int(parts["under"])
        feet = float(parts.get("feet") or 0)
        if feet and inches >= 12:
            return None
        return Measure(round(feet * _FOOT + inches * _INCH, 7), "feet")
    return None


def _metric(text: str) -> Measure | None:
    stated = _WITH_UNIT.match(text)
    if stated is not None:
        number = _number(stated["number"].strip())
        unit = stated["unit"].lower()
        if number is None:
            return None
        if unit == "mm" and _THOUSANDS.match(stated["number"].strip()):
            number *= 1000 if number < 1000 else 1
        return Measure(number * _STATED[unit], "stated")
    if sum(c.isdecimal() for c in text) * 2 >= len(text):
        text = text.translate(_DIGITS)
    if _INTEGER.match(text) and text[0] != "0":
        return Measure(float(text), "integer")
    if re.match(r"^\d{1,3} \d{3}$", text) and text[0] != "0":
        return Measure(float(text.replace(" ", "")), "integer")
    if _DECIMAL.match(text) and not re.match(r"^0\d", text):
        number = _number(text)
        return None if number is None else Measure(number, "metres")
    return None


def _number(text: str) -> float | None:
    """Return a number written with comma or point; spaces set thousands apart."""
    try:
        return float(text.replace(" ", "").replace(",", "."))
    except ValueError:
        return None
