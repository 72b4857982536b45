"""What a sender says of a drawing beside its bytes: the scale and the page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

from service.domain.errors import InvalidRequest
from service.domain.scale import KnownLength, ScaleHint

_LENGTH = ("x1", "y1", "x2", "y2", "length_m")
_SCALE = ("metres_per_unit", "ratio", "dpi", "known_length")
_MAX_NUMBER = 1e12
_NOT_YET = {"crop": "Cropping", "keep": "Keeping strokes", "drop": "Dropping strokes"}


@dataclass(frozen=True)
class DrawingOptions:
    """Hold the scale, if it was said, and the page of the document, counted from 1."""

    scale: ScaleHint | None = None
    page: int = 1

    def to_json(self) -> dict[str, Any]:
        """Return the options as a JSON object; without ``scale`` where it was not said."""
        said: dict[str, Any] = {"page": self.page}
        if self.scale is not None:
            said["scale"] = self.scale.to_json()
        return said

    def changed(self, value: Mapping[str, Any]) -> Self:
        """Return the options with those that a JSON object names replaced.

        Raises
        ------
        InvalidRequest
            If it names none, one that is not known or not supported yet, or one of a wrong form.
        """
        if not value:
            raise _invalid("#", "Nothing to change was given: send scale, page, or both.")
        for name in value:
            if name in _NOT_YET:
                raise _invalid(f"#/{name}", f"{_NOT_YET[name]} is not supported yet: change the file itself.")
            if name not in {"scale", "page"}:
                raise _invalid(f"#/{name}", f"A drawing has no option {name!r}.")
        new = self
        if "scale" in value:
            new = replace(new, scale=_scale(value["scale"]))
        if "page" in value:
            new = replace(new, page=_page(value["page"]))
        return new

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Self:
        """Return the options that `to_json` wrote, or those of a JSON object that a sender wrote.

        Raises
        ------
        InvalidRequest
            As `changed`.
        """
        return cls().changed(value) if value else cls()

    @classmethod
    def from_fields(cls, fields: Mapping[str, str]) -> Self:
        """Return the options that the fields of a form give.

        The scale comes as one field ``scale`` (JSON), or as ``metres_per_unit``, as ``ratio`` (``100`` or
        ``1:100``) with ``dpi``, or as ``known_length`` (``x1,y1,x2,y2,L``).

        Raises
        ------
        InvalidRequest
            If a field is unknown or wrong, or the scale is given in more than one way.
        """
        value: dict[str, Any] = {}
        scale: dict[str, Any] = {}
        for name, text in fields.items():
            if name == "scale":
                value["scale"] = _json(text, "#/scale")
            elif name == "page":
                value["page"] = int(text) if text.strip().isdecimal() and len(text) < 7 else text
            elif name == "known_length":
                scale[name] = _length_of(text)
            elif name in _SCALE:
                scale[name] = _float(text.strip().removeprefix("1:"), f"#/{name}")
            else:
                value[name] = text
        if scale and "scale" in value:
            raise _invalid("#/scale", f"The scale is given twice: by scale and by {min(scale)}.")
        if scale:
            value["scale"] = scale
        return cls.from_json(value)


def _scale(value: object) -> ScaleHint:
    if not isinstance(value, Mapping):
        raise _invalid("#/scale", "A scale is an object: metres_per_unit, or ratio and dpi, or known_length.")
    said: dict[str, Any] = {}
    for name, found in value.items():
        pointer = f"#/scale/{name}"
        if name not in _SCALE:
            raise _invalid(pointer, f"A scale has no field {name!r}.")
        said[name] = _known_length(found, pointer) if name == "known_length" else _number(found, pointer)
    hint = ScaleHint(**said)
    hint.metres_per_px()
    if hint.dpi is not None and hint.ratio is None:
        raise _invalid("#/scale/dpi", "The dpi goes with a ratio; give both or neither.")
    return hint


def _known_length(value: object, pointer: str) -> KnownLength:
    if not isinstance(value, Mapping) or set(value) != set(_LENGTH):
        raise _invalid(pointer, f"A known length is an object with exactly {', '.join(_LENGTH)}.")
    return KnownLength(**{name: _number(value[name], f"{pointer}/{name}") for name in _LENGTH})


def _length_of(text: str) -> dict[str, float]:
    numbers = [_float(word, "#/known_length") for word in text.split(",")]
    if len(numbers) != len(_LENGTH):
        raise _invalid("#/known_length", "A known length is five numbers: x1,y1,x2,y2,L.")
    return dict(zip(_LENGTH, numbers, strict=True))


def _page(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 100_000:
        raise _invalid("#/page", f"{value!r} is no page number; pages count from 1.")
    return value


def _number(value: object, pointer: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= _MAX_NUMBER:
        raise _invalid(pointer, f"{value!r} is no finite number below 1e12.")
    return float(value)


def _float(text: str, pointer: str) -> float:
    try:
        return _number(float(text), pointer)
    except ValueError:
        raise _invalid(pointer, f"{text[:40]!r} is no number.") from None


def _json(text: str, pointer: str) -> object:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _invalid(pointer, f"The field is no JSON: {error}.") from None


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
