"""What a sender says of a drawing beside its bytes: the scale, what part of it is read, and corrections."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from service.domain.edits import Edit, edit_to_json, edits_of
from service.domain.errors import InvalidRequest
from service.domain.scale_hint import KnownLength, ScaleHint

MAX_WALL_LAYERS = 200
MAX_KNOWN_LENGTHS = 50

_LENGTH = ("x1", "y1", "x2", "y2", "length_m")
_SCALE = ("metres_per_unit", "ratio", "dpi", "known_length", "known_lengths")
_MAX_NUMBER = 1e12
_MAX_NAME = 255
_INSTEAD = {
    "crop": "send an edit with the action include",
    "keep": "send an edit with the action move",
    "drop": "send an edit with the action move",
}


@dataclass(frozen=True)
class DrawingOptions:
    """Hold what was said of a drawing; a field that was not said is None or empty.

    Parameters
    ----------
    scale : ScaleHint, optional
        The scale, in one way.
    page : int, optional
        The page of the document, counted from 1.
    storey : str, optional
        The storey of a building model, by its name.
    cut_height_m : float, optional
        Height above the storey's floor at which a building model is cut.
    wall_layers : tuple of str, optional
        The layers of a vector file that hold its walls, by their names; None where the names and the
        geometry decide.
    edits : tuple of Edit
        A person's corrections, in their order.
    replaces : str, optional
        The id of the drawing of which this is a new issue.
    """

    scale: ScaleHint | None = None
    page: int | None = None
    storey: str | None = None
    cut_height_m: float | None = None
    wall_layers: tuple[str, ...] | None = None
    edits: tuple[Edit, ...] = ()
    replaces: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return what was said, as a JSON object; what was not said is left out."""
        said: dict[str, Any] = {}
        for name in ("page", "storey", "cut_height_m", "replaces"):
            if (value := getattr(self, name)) is not None:
                said[name] = value
        if self.scale is not None:
            said["scale"] = self.scale.to_json()
        if self.wall_layers is not None:
            said["wall_layers"] = list(self.wall_layers)
        if self.edits:
            said["edits"] = [edit_to_json(edit) for edit in self.edits]
        return said

    def changed(self, value: Mapping[str, Any]) -> Self:
        """Return the options with those that a JSON object names replaced; null takes one back.

        Raises
        ------
        InvalidRequest
            If it names none, one that is not known, or one of a wrong form.
        """
        if not value:
            raise _invalid("#", f"Nothing to change was given: send one of {', '.join(_PARSED)}.")
        new: dict[str, Any] = {}
        for name, found in value.items():
            if name in _INSTEAD:
                raise _invalid(f"#/{name}", f"A drawing has no option {name!r}: {_INSTEAD[name]}.")
            if name not in _PARSED:
                raise _invalid(f"#/{name}", f"A drawing has no option {str(name)[:40]!r}.")
            new[name] = _NOT_SAID.get(name) if found is None else _PARSED[name](found)
        return replace(self, **new)

    def completed_by(self, other: DrawingOptions) -> Self:
        """Return these options, where they say nothing completed by those of an earlier issue."""
        names = ("scale", "page", "storey", "cut_height_m", "wall_layers")
        kept = {name: getattr(other, name) for name in names if getattr(self, name) is None}
        return replace(self, **kept, edits=self.edits or other.edits)

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
        ``1:100``) with ``dpi``, or as ``known_length`` (``x1,y1,x2,y2,L``; several with ``;`` between).
        ``edits`` and ``wall_layers`` are JSON lists.

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
            elif name in {"edits", "wall_layers"}:
                value[name] = _json(text, f"#/{name}")
            elif name == "page":
                value[name] = int(text) if text.strip().isdecimal() and len(text) < 7 else text
            elif name == "cut_height_m":
                value[name] = _float(text, f"#/{name}")
            elif name == "known_length":
                scale |= _lengths_of(text)
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
        if name == "known_length":
            said[name] = _known_length(found, pointer)
        else:
            said[name] = _known_lengths(found) if name == "known_lengths" else _number(found, pointer)
    hint = ScaleHint(**said)
    hint.metres_per_px()
    if hint.dpi is not None and hint.ratio is None:
        raise _invalid("#/scale/dpi", "The dpi goes with a ratio; give both or neither.")
    return hint


def _known_lengths(value: object) -> tuple[KnownLength, ...]:
    pointer = "#/scale/known_lengths"
    if not isinstance(value, Sequence) or isinstance(value, str | bytes) or not value:
        raise _invalid(pointer, "Known lengths are a list, and at least one.")
    if len(value) > MAX_KNOWN_LENGTHS:
        raise _invalid(pointer, f"There are {len(value)} lengths; at most {MAX_KNOWN_LENGTHS} are taken.")
    return tuple(_known_length(one, f"{pointer}/{index}") for index, one in enumerate(value))


def _known_length(value: object, pointer: str) -> KnownLength:
    if not isinstance(value, Mapping) or set(value) != set(_LENGTH):
        raise _invalid(pointer, f"A known length is an object with exactly {', '.join(_LENGTH)}.")
    return KnownLength(**{name: _number(value[name], f"{pointer}/{name}") for name in _LENGTH})


def _lengths_of(text: str) -> dict[str, Any]:
    lengths = [_length_of(one) for one in text.split(";")[: MAX_KNOWN_LENGTHS + 1]]
    return {"known_length": lengths[0]} if len(lengths) == 1 else {"known_lengths": lengths}


def _length_of(text: str) -> dict[str, float]:
    numbers = [_float(word, "#/known_length") for word in text.split(",")]
    if len(numbers) != len(_LENGTH):
        raise _invalid("#/known_length", "A known length is five numbers: x1,y1,x2,y2,L.")
    return dict(zip(_LENGTH, numbers, strict=True))


def _page(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= 100_000:
        raise _invalid("#/page", f"{value!r} is no page number; pages count from 1.")
    return value


def _cut_height(value: object) -> float:
    height = _number(value, "#/cut_height_m")
    if not 0.0 < height <= 100.0:
        raise _invalid("#/cut_height_m", f"{height:g} m is no height of a cut; it lies between 0 and 100 m.")
    return height


def _storey(value: object) -> str:
    return _name(value, "#/storey", "the name of a storey")


def _replaces(value: object) -> str:
    return _name(value, "#/replaces", "the id of a drawing")


def _wall_layers(value: object) -> tuple[str, ...]:
    pointer = "#/wall_layers"
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        raise _invalid(pointer, "The wall layers are a list of names.")
    if len(value) > MAX_WALL_LAYERS:
        raise _invalid(pointer, f"There are {len(value)} layers; at most {MAX_WALL_LAYERS} are taken.")
    return tuple(_name(one, f"{pointer}/{index}", "the name of a layer") for index, one in enumerate(value))


def _name(value: object, pointer: str, what: str) -> str:
    if not isinstance(value, str) or not 1 <= len(value) <= _MAX_NAME or not value.isprintable():
        raise _invalid(pointer, f"This is not {what}: 1 to {_MAX_NAME} characters that can be printed.")
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


_PARSED: Mapping[str, Callable[[object], Any]] = {
    "scale": _scale,
    "page": _page,
    "storey": _storey,
    "cut_height_m": _cut_height,
    "wall_layers": _wall_layers,
    "edits": edits_of,
    "replaces": _replaces,
}
_NOT_SAID: Mapping[str, Any] = {"edits": ()}
