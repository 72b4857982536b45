"""The unit of a CAD drawing: its header is only one witness among doors, walls, extent and dimensions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.domain.findings import Finding
from service.domain.scale_hint import ScaleHint
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.pairs import Lines, crowded, distinct, stretches
from worker.geometry.drawing.linework.roles import assign_roles
from worker.geometry.drawing.scale.decision import USUAL_UNITS, Scale, Witness, contradictions, decide
from worker.geometry.drawing.scale.dimension_texts import parse_measure
from worker.geometry.drawing.scale.sheet_scale import SheetScale
from worker.geometry.drawing.scale.title_block import not_to_scale

_ASSUMED_EXTENT = 40.0
"""How long a drawing of unknown scale is taken to be [m] where a threshold needs metres: a usual building."""

_EXTENT = (8.0, 400.0)
_DOOR = (0.6, 1.2)
_SPACING = (0.08, 0.4)
_SWEEP = (math.radians(60.0), math.radians(185.0))
_LEAF = 0.1
_HINGE = 0.15
_SHARE_OF_EXTENT = 20.0
_MOST_LINES = 5_000
_MOST_DIMENSIONS = 2000
_EXACT = 0.01
_MOST_COUNT = 3
_SURE = {"door-arcs": 3, "dimension-text": 2, "title-block": 1}


def assumed_unit(linework: Linework, scale: Scale) -> float:
    """Return metres a unit for thresholds: the scale, its best candidate, or what makes the drawing 40 m."""
    if scale.metres_per_unit is not None:
        return scale.metres_per_unit
    if scale.candidates:
        return scale.candidates[0]
    points = linework.ends.reshape(-1, 2)
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return _ASSUMED_EXTENT / extent if extent > 0 else 1.0


def find_unit(linework: Linework, *, hint: ScaleHint | None = None) -> SheetScale:
    """Return the unit of a CAD drawing, found where at least two voices agree on one, else unknown.

    Buildings are 8 to 400 m long, doors swing over 0.6 to 1.2 m, walls are 8 to 40 cm thick, and a dimension
    whose text was written by hand says how long its line is. The file's own header is one voice among these:
    most files say millimetres, whatever they are drawn in. Where doors, dimensions or a sheet disprove
    it, it has no vote.

    Parameters
    ----------
    linework : Linework
        What its header says stands among its witnesses already.
    hint : ScaleHint, optional
        What a person said.

    Returns
    -------
    SheetScale
        One of metres, centimetres, millimetres, inches and feet, or what the file's own sheet states.

    Raises
    ------
    InvalidRequest
        If the hint is incomplete or contradictory in itself.
    """
    roles = assign_roles(linework, wall_layers=None)
    walls = linework.ends[(roles.entity == "wall")[linework.entity]] if roles.walls_known else linework.ends
    heard = [*linework.witnesses, *_extent(walls), *_doors(linework, roles.entity)]
    heard += [*_spacing(walls), *_dimensions(linework)]
    units = [*USUAL_UNITS.values(), *(w.value for w in linework.witnesses if w.kind == "title-block")]
    veto = not_to_scale([t.text for t in linework.texts])
    voting = [w for w in heard if w.kind != "file-unit" or not _disproved(w, heard, units)]
    scale = decide(voting, hint=hint, units=units, vetoed=veto is not None)
    scale = replace(scale, witnesses=(*scale.witnesses, *(w for w in heard if w not in voting)))
    findings = [] if veto is None else [_veto(veto)]
    return SheetScale(scale, (), (*findings, *contradictions(scale)))


def _disproved(header: Witness, heard: Sequence[Witness], units: Sequence[float]) -> bool:
    """Return whether the header's unit contradicts what is measured: then it has no vote."""
    strong = [w for w in heard if w.count >= _SURE.get(w.kind, math.inf)]
    named = [w for w in strong if any(w.allows(unit) for unit in units)]
    return any(not w.allows(header.value) for w in named)


def _extent(walls: NDArray[np.float64]) -> list[Witness]:
    if not len(walls):
        return []
    size = float(np.ptp(walls.reshape(-1, 2), axis=0).max())
    if not size > 0:
        return []
    detail = f"The drawing is {size:.4g} units long: buildings are {_EXTENT[0]:g} to {_EXTENT[1]:g} m."
    return [Witness("extent", _EXTENT[0] / size, _EXTENT[1] / size, detail)]


def _doors(linework: Linework, role: NDArray[np.str_]) -> list[Witness]:
    """Return how wide the doors can be: arcs with a leaf from their centre, as long as their radius."""
    if linework.arcs is None or not len(linework.arcs) or not len(linework.ends):
        return []
    sweep = np.abs(linework.arcs[:, 4])
    arcs = linework.arcs[(sweep >= _SWEEP[0]) & (sweep <= _SWEEP[1])][:_MOST_LINES]
    drawn = ~np.isin(role, ["furniture", "text", "dimension", "hatch"])[linework.entity]
    radii = arcs[_have_leaves(arcs[:, :3], linework.ends[drawn]), 2]
    if not len(radii):
        return []
    r = float(np.median(radii))
    detail = f"{len(radii)} doors swing with a radius of {r:.4g} units: doors are {_DOOR[0]} to {_DOOR[1]} m."
    return [Witness("door-arcs", _DOOR[0] / r, _DOOR[1] / r, detail, len(radii))]


def _have_leaves(arcs: NDArray[np.float64], ends: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return by which arcs, given as (x, y, radius), a line of the radius begins or ends near the centre."""
    length = np.repeat(np.hypot(*(ends[:, 1] - ends[:, 0]).T), 2)
    hinges = cKDTree(ends.reshape(-1, 2))
    near = hinges.query_ball_point(arcs[:, :2], _HINGE * arcs[:, 2])
    return np.array(
        [(np.abs(length[n] - r) <= _LEAF * r).any() for n, r in zip(near, arcs[:, 2], strict=True)], bool
    )


def _spacing(walls: NDArray[np.float64]) -> list[Witness]:
    """Return how thick the walls can be: the usual distance of a line from its nearest parallel."""
    walls = walls[distinct(walls / max(float(np.ptp(walls)), 1e-9) * 1000.0)] if len(walls) else walls
    if not len(walls) >= 8:
        return []
    if len(walls) > _MOST_LINES:
        length = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
        walls = walls[np.argsort(-length)[:_MOST_LINES]]
    extent = float(np.ptp(walls.reshape(-1, 2), axis=0).max())
    reach = extent / _SHARE_OF_EXTENT
    lines = Lines.of(walls)
    if crowded(lines, reach=reach):
        return []
    found = stretches(lines, thickest=reach, thinnest=reach / 1000, least=reach / 1000)
    nearest: dict[int, tuple[float, float]] = {}
    for s in found:
        if s.length >= 1.5 * s.spacing:
            for line in (s.i, s.j):
                nearest[line] = min(nearest.get(line, (math.inf, 0.0)), (s.spacing, s.length))
    if len(nearest) < 4:
        return []
    spacing, weight = np.array(list(nearest.values())).T
    order = np.argsort(spacing)
    passed = np.cumsum(weight[order])
    usual = float(spacing[order][np.searchsorted(passed, passed[-1] / 2)])
    detail = (
        f"{len(nearest)} lines run {usual:.4g} units from their neighbours: walls are "
        f"{_SPACING[0]} to {_SPACING[1]} m thick."
    )
    return [Witness("wall-spacing", _SPACING[0] / usual, _SPACING[1] / usual, detail, len(nearest))]


def _dimensions(linework: Linework) -> list[Witness]:
    """Return the units that dimensions with a text written by hand name, each with how many lengths."""
    named: dict[float, set[int]] = {}
    for dimension in linework.dimensions[:_MOST_DIMENSIONS]:
        measure = parse_measure(dimension.shown) if dimension.shown else None
        if measure is None or not dimension.length > 0:
            continue
        factors = (0.001, 0.01) if measure.form == "integer" else (1.0,)
        for factor in factors:
            value = measure.value * factor / dimension.length
            for unit in USUAL_UNITS.values():
                if abs(value - unit) <= _EXACT * unit:
                    named.setdefault(unit, set()).add(round(math.log(dimension.length) / 0.02))
    return [
        Witness(
            "dimension-text",
            unit,
            unit,
            f"{len(lengths)} dimensions say that a unit is {unit:g} m.",
            min(len(lengths), _MOST_COUNT),
        )
        for unit, lengths in named.items()
    ]


def _veto(text: str) -> Finding:
    return Finding(
        "not-to-scale",
        "warning",
        f"The drawing says of itself that it is not to scale ({text!r}): measure a length on it yourself.",
        {"text": text},
    )
