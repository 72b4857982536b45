"""What of a vector drawing is no wall: every stroke with a layer and a reason, and the file's own layers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.roles import Roles, entity_lengths
from worker.geometry.drawing.reading.reading import RemovedStroke, SourceLayer
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
    first = np.searchsorted(linework.entity, np.arange(len(linework.kind) + 1))
    placed = place(linework.ends.reshape(-1, 2)).reshape(-1, 2, 2)
    out = []
    for e in np.flatnonzero(~kept).tolist():
        ends = placed[first[e] : first[e + 1]]
        if len(ends):
            layer, reason = _why(linework, roles, e)
            out.append(RemovedStroke(_polylines(ends), layer, reason))
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


def _why(linework: Linework, roles: Roles, e: int) -> tuple[str, str]:
    """Return the layer of the reading in which an entity is set aside, and the reason."""
    role, kind = str(roles.entity[e]), str(linework.kind[e])
    number = int(linework.layer[e])
    name = linework.layer_names[number] if linework.layer_names else ""
    where = f"On layer {name!r}. " if name else ""
    if role == "wall" and linework.filled[e]:
        return "hatch", f"{where}A filled area whose outline the walls' lines repeat."
    if kind in {"dimension", "leader"}:
        return "dimension", f"{where}It is a {kind}."
    if kind == "hatch":
        return "hatch", f"{where}It is a hatch."
    if role == "other" and linework.dashed[e]:
        return "dashed", f"{where}A dashed line."
    return role, where + (
        roles.layer_reason[number] if name else "No lines at a wall's thickness run along it."
    )


def _polylines(ends: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Return (N, 2, 2) segments of one entity as polylines."""
    breaks = np.flatnonzero((ends[1:, 0] != ends[:-1, 1]).any(axis=1)) + 1
    return tuple(np.vstack([part[:, 0], part[-1:, 1]]) for part in np.split(ends, breaks))


def _text(text: Text, place: Place) -> RemovedStroke:
    half = 0.5 * _LETTER * text.height * max(len(text.text), 1)
    step = np.array([np.cos(text.angle), np.sin(text.angle)]) * half
    middle = np.array([text.x, text.y])
    shown = text.text if len(text.text) <= _SHOWN else text.text[: _SHOWN - 1] + "…"
    return RemovedStroke((place(np.stack([middle - step, middle + step])),), "text", f"Text: {shown!r}.")
