"""What a person corrects in a drawing's reading: moved strokes, regions, walls added and erased."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from service.domain.errors import InvalidRequest

MAX_EDITS = 500
MAX_VERTICES = 1_000
MAX_STROKES = 1_000
MAX_THICKNESS_M = 10.0
Layer = Literal[
    "wall",
    "column",
    "door",
    "window",
    "stair",
    "text",
    "dimension",
    "hatch",
    "furniture",
    "frame",
    "grid",
    "dashed",
    "symbol",
    "speck",
    "light-pen",
    "small",
    "other",
]
LAYERS: tuple[Layer, ...] = get_args(Layer)
"""The layers of a reading; `wall` is what a map is made of, the others are set aside."""

_MAX_NUMBER = 1e12
_STROKE_ID = re.compile(r"[swc](?:-?\d{1,13}(?:\.\d{1,9})?)(?:_-?\d{1,13}(?:\.\d{1,9})?){3}(?:~\d{1,6})?")

Point = tuple[float, float]


@dataclass(frozen=True)
class Move:
    """Hold that strokes belong to another layer.

    Parameters
    ----------
    to : str
        One of `LAYERS`.
    strokes : tuple of str
        Ids of ``walls.geojson`` and ``removed.geojson``.
    within : tuple of points
        Or a polygon, in the file's own coordinates: what lies in it by more than half.
    of : tuple of str
        With `within`: only what is in one of these layers; empty for every other layer than `to`.
    """

    action: ClassVar[str] = "move"
    to: Layer
    strokes: tuple[str, ...] = ()
    within: tuple[Point, ...] = ()
    of: tuple[Layer, ...] = ()


@dataclass(frozen=True)
class Include:
    """Hold a polygon outside of which (and of other such polygons) nothing counts."""

    action: ClassVar[str] = "include"
    within: tuple[Point, ...]


@dataclass(frozen=True)
class Exclude:
    """Hold a polygon in which nothing counts."""

    action: ClassVar[str] = "exclude"
    within: tuple[Point, ...]


@dataclass(frozen=True)
class AddWall:
    """Hold a wall that the drawing does not show.

    Parameters
    ----------
    line : tuple of points
        Its centre line, in the file's own coordinates.
    thickness_m : float, optional
        Distance of its faces; None for that of the drawing's other walls.
    """

    action: ClassVar[str] = "add-wall"
    line: tuple[Point, ...]
    thickness_m: float | None = None


@dataclass(frozen=True)
class EraseWalls:
    """Hold a polygon in which walls are cut away; what is left of them outside stays."""

    action: ClassVar[str] = "erase-walls"
    within: tuple[Point, ...]


Edit = Move | Include | Exclude | AddWall | EraseWalls

_FIELDS = {
    "move": {"to", "strokes", "within", "of"},
    "include": {"within"},
    "exclude": {"within"},
    "add-wall": {"line", "thickness_m"},
    "erase-walls": {"within"},
}


def edits_of(value: object, pointer: str = "#/edits") -> tuple[Edit, ...]:
    """Return the edits of a JSON list.

    All coordinates are the file's own, as those of a known length: pixels of the sheet (y down), or drawing
    units of a vector file (y up). A later change of the scale does not move them.

    Raises
    ------
    InvalidRequest
        If it is no list of edits, an edit is of a wrong form, or there are too many of anything; each place
        is named.

    Examples
    --------
    >>> edits_of([{"action": "exclude", "within": [[0, 0], [90, 0], [90, 40]]}])
    (Exclude(within=((0.0, 0.0), (90.0, 0.0), (90.0, 40.0))),)
    """
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        raise _invalid(pointer, "Edits are a list of objects.")
    if len(value) > MAX_EDITS:
        raise _invalid(pointer, f"There are {len(value)} edits; at most {MAX_EDITS} are taken.")
    return tuple(_edit(one, f"{pointer}/{index}") for index, one in enumerate(value))


def edit_to_json(edit: Edit) -> dict[str, Any]:
    """Return an edit as `edits_of` takes it."""
    out: dict[str, Any] = {"action": edit.action}
    for name in ("within", "line"):
        if points := getattr(edit, name, ()):
            out[name] = [[x, y] for x, y in points]
    if isinstance(edit, Move):
        out["to"] = edit.to
        out |= {name: list(found) for name in ("strokes", "of") if (found := getattr(edit, name))}
    if isinstance(edit, AddWall) and edit.thickness_m is not None:
        out["thickness_m"] = edit.thickness_m
    return out


def _edit(value: object, pointer: str) -> Edit:
    if not isinstance(value, Mapping):
        raise _invalid(pointer, "An edit is an object with an action.")
    action = value.get("action")
    if not isinstance(action, str) or action not in _FIELDS:
        raise _invalid(f"{pointer}/action", f"An action is one of {', '.join(_FIELDS)}.")
    for name in value:
        if name != "action" and name not in _FIELDS[action]:
            raise _invalid(f"{pointer}/{name}", f"The action {action} has no field {str(name)[:40]!r}.")
    if action == "move":
        return _move(value, pointer)
    if action == "add-wall":
        thickness = value.get("thickness_m")
        return AddWall(
            _points(value.get("line"), f"{pointer}/line", least=2),
            None if thickness is None else _thickness(thickness, f"{pointer}/thickness_m"),
        )
    within = _points(value.get("within"), f"{pointer}/within", least=3)
    return (
        Include(within) if action == "include" else (Exclude if action == "exclude" else EraseWalls)(within)
    )


def _move(value: Mapping[str, Any], pointer: str) -> Move:
    if ("strokes" in value) == ("within" in value):
        raise _invalid(pointer, "A move names its strokes, or the polygon that they lie within; one of both.")
    to = value.get("to")
    if to not in LAYERS:
        raise _invalid(f"{pointer}/to", f"A layer is one of {', '.join(LAYERS)}.")
    if "strokes" in value:
        if "of" in value:
            raise _invalid(f"{pointer}/of", "The layers to move from go with a polygon.")
        return Move(to, strokes=_ids(value["strokes"], f"{pointer}/strokes"))
    within = _points(value["within"], f"{pointer}/within", least=3)
    return Move(to, within=within, of=_layers(value.get("of", ()), f"{pointer}/of"))


def _ids(value: object, pointer: str) -> tuple[str, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str | bytes) or not value:
        raise _invalid(pointer, "The strokes are a list of ids, and at least one.")
    if len(value) > MAX_STROKES:
        raise _invalid(pointer, f"There are {len(value)} strokes; at most {MAX_STROKES} are moved at once.")
    for index, one in enumerate(value):
        if not isinstance(one, str) or not _STROKE_ID.fullmatch(one):
            raise _invalid(f"{pointer}/{index}", f"{str(one)[:40]!r} is no id of a stroke.")
    return tuple(value)


def _layers(value: object, pointer: str) -> tuple[Layer, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str | bytes) or len(value) > len(LAYERS):
        raise _invalid(pointer, "The layers to move from are a list.")
    for index, one in enumerate(value):
        if one not in LAYERS:
            raise _invalid(f"{pointer}/{index}", f"A layer is one of {', '.join(LAYERS)}.")
    return tuple(value)


def _points(value: object, pointer: str, *, least: int) -> tuple[Point, ...]:
    if not isinstance(value, Sequence) or isinstance(value, str | bytes) or len(value) < least:
        raise _invalid(pointer, f"This is a list of at least {least} points [x, y].")
    if len(value) > MAX_VERTICES:
        raise _invalid(pointer, f"There are {len(value)} points; at most {MAX_VERTICES} are taken.")
    points = tuple(_point(one, f"{pointer}/{index}") for index, one in enumerate(value))
    if len(set(points)) < least:
        raise _invalid(pointer, f"At least {least} of the points have to differ.")
    return points


def _point(value: object, pointer: str) -> Point:
    if not isinstance(value, Sequence) or isinstance(value, str | bytes) or len(value) != 2:
        raise _invalid(pointer, "A point is a list of two numbers, x and y.")
    return _number(value[0], f"{pointer}/0"), _number(value[1], f"{pointer}/1")


def _thickness(value: object, pointer: str) -> float:
    thickness = _number(value, pointer)
    if not 0.0 < thickness <= MAX_THICKNESS_M:
        raise _invalid(pointer, f"A wall's thickness lies between 0 and {MAX_THICKNESS_M:g} m.")
    return thickness


def _number(value: object, pointer: str) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= _MAX_NUMBER:
        raise _invalid(pointer, f"{str(value)[:40]} is no finite number below 1e12.")
    assert math.isfinite(value)
    return float(value)


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
