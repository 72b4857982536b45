"""What of a vector drawing is no wall: every stroke with a layer and a reason, and the file's own layers."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.domain.drawing_reading import SourceLayer
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.roles import Roles, entity_lengths
from worker.geometry.drawing.reading.reading import RemovedStroke
from worker.geometry.drawing.text import Text

_LETTER = 0.6
_SHOWN = 40

Place = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def removed_strokes(
    linework: Linework, roles: Roles, *, kept: NDArray[np.bool_], place: Place
) -> tuple[RemovedStroke, ...]:
    """Return every entity that is not `kept`, and every text, as strokes with a layer and a reason.

    Parameters
    ----------
    linework : Linework
        The drawing.
    roles : Roles
        As what its layers and entities were taken.
    kept : ndarray of shape (E,), bool
        Entities that walls and columns account for.
    place : callable
        Turns (N, 2) points in drawing units into frame `drawing`.
    """
    gone = ~kept[linework.entity]
    entity = linework.entity[gone]
    lines, owner = _polylines(place(linework.ends[gone].reshape(-1, 2)).reshape(-1, 2, 2), entity)
    present, first = np.unique(owner, return_index=True)
    why = _Reasons(linework, roles)
    out = []
    for e, (a, b) in zip(present.tolist(), pairwise([*first.tolist(), len(lines)]), strict=True):
        out.append(RemovedStroke(tuple(lines[a:b]), *why(e)))
    out += [_text(text, place) for text in linework.texts]
    return tuple(out)


def source_layers(linework: Linework, roles: Roles, factor: float) -> tuple[SourceLayer, ...]:
    """Return the file's layers that hold lines, the longest first, with roles; lengths times `factor`."""
    length = np.bincount(
        linework.layer, weights=entity_lengths(linework), minlength=len(linework.layer_names)
    )
    told = zip(linework.layer_names, roles.layer_role, roles.layer_reason, length * factor, strict=True)
    layers = [SourceLayer(name, role, reason, float(size)) for name, role, reason, size in told if size > 0]
    return tuple(sorted(layers, key=lambda layer: -layer.length))


class _Reasons:
    """Say in which layer of the reading an entity is set aside, and why; alike ones share their words."""

    def __init__(self, linework: Linework, roles: Roles) -> None:
        self._names, self._told = linework.layer_names, roles.layer_reason
        self._marks = list(
            zip(
                roles.entity.tolist(),
                linework.kind.tolist(),
                linework.layer.tolist(),
                linework.filled.tolist(),
                linework.dashed.tolist(),
                strict=True,
            )
        )
        self._known: dict[tuple[str, str, int, bool, bool], tuple[str, str]] = {}

    def __call__(self, e: int) -> tuple[str, str]:
        marks = self._marks[e]
        if marks not in self._known:
            self._known[marks] = self._why(*marks)
        return self._known[marks]

    def _why(self, role: str, kind: str, number: int, filled: bool, dashed: bool) -> tuple[str, str]:  # noqa: FBT001 - as they are kept
        name = self._names[number] if self._names else ""
        where = f"On layer {name!r}. " if name else ""
        if role == "wall" and filled:
            return "hatch", f"{where}A filled area whose outline the walls' lines repeat."
        if kind in {"dimension", "leader"}:
            return "dimension", f"{where}It is a {kind}."
        if kind == "hatch":
            return "hatch", f"{where}It is a hatch."
        if role == "other" and dashed:
            return "dashed", f"{where}A dashed line."
        return role, where + (self._told[number] if name else "No lines at a wall's thickness run along it.")


def _polylines(
    ends: NDArray[np.float64], entity: NDArray[np.int64]
) -> tuple[list[NDArray[np.float64]], NDArray[np.int64]]:
    """Return (N, 2, 2) segments of entities as polylines, each with its entity."""
    if not len(ends):
        return [], entity
    breaks = (ends[1:, 0] != ends[:-1, 1]).any(axis=1) | (entity[1:] != entity[:-1])
    first = np.flatnonzero(np.concatenate([[True], breaks]))
    last = np.append(first[1:], len(ends)) - 1
    points = np.insert(ends[:, 0], last + 1, ends[last, 1], axis=0)
    at = first + np.arange(len(first))
    lines = [points[a:b] for a, b in pairwise([*at.tolist(), len(points)])]
    return lines, entity[first]


def _text(text: Text, place: Place) -> RemovedStroke:
    half = 0.5 * _LETTER * text.height * max(len(text.text), 1)
    step = np.array([np.cos(text.angle), np.sin(text.angle)]) * half
    middle = np.array([text.x, text.y])
    shown = text.text if len(text.text) <= _SHOWN else text.text[: _SHOWN - 1] + "…"
    return RemovedStroke((place(np.stack([middle - step, middle + step])),), "text", f"Text: {shown!r}.")
