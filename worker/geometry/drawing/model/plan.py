"""A plan that a building model or an annotation tells directly, as a reading in frame `drawing`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from service.domain.drawing_reading import SourceLayer
from service.domain.findings import Finding
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall
from worker.geometry.drawing.scale.decision import Scale

_MARGIN = 0.5


@dataclass(frozen=True, eq=False)
class Piece:
    """Hold one thing that is set aside: its (K, 2) line [m], the layer it goes to, and why."""

    line: NDArray[np.float64]
    layer: str
    reason: str


@dataclass(frozen=True, eq=False)
class Plan:
    """Hold a plan in the file's own coordinates times `unit`, y up.

    Parameters
    ----------
    walls, columns, set_aside : tuple
        In metres, if `unit` is right.
    layers : dict of str to str
        The file's classes or layers, and as what each was taken.
    findings : tuple of Finding
        Remarks of the loader.
    unit : float
        By how many metres a unit of the file was multiplied; 1 where it states none.
    style : str
        As `Reading.style`.
    """

    walls: tuple[Wall, ...]
    columns: tuple[Column, ...] = ()
    set_aside: tuple[Piece, ...] = ()
    layers: dict[str, str] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    unit: float = 1.0
    style: str = "outlined"


def plan_reading(plan: Plan, scale: Scale) -> Reading:
    """Return a plan as a reading, its origin at the lower left of all that is drawn.

    Parameters
    ----------
    plan : Plan
        At least one wall.
    scale : Scale
        Where it is unknown, the reading is in the file's units and a finding says so; where a person gave
        another than `plan.unit`, everything is stretched to it.
    """
    lines = [line for w in plan.walls for line in (w.centre, *w.faces)]
    lines += [c.outline for c in plan.columns] + [p.line for p in plan.set_aside]
    points = np.vstack(lines)
    low = np.floor((points.min(axis=0) - _MARGIN) * 100.0) / 100.0
    size = points.max(axis=0) + _MARGIN - low
    reading = Reading(
        tuple(
            replace(w, centre=w.centre - low, faces=(w.faces[0] - low, w.faces[1] - low)) for w in plan.walls
        ),
        tuple(replace(c, outline=c.outline - low) for c in plan.columns),
        tuple(RemovedStroke((p.line - low,), p.layer, p.reason) for p in plan.set_aside),
        (float(size[0]), float(size[1])),
        scale,
        plan.style,
        findings=plan.findings,
        origin=(float(low[0]), float(low[1])),
        layers=_layers(plan),
    )
    if scale.metres_per_unit is None:
        return replace(reading.scaled(1.0 / plan.unit), findings=(*plan.findings, _unknown()))
    return (
        reading if scale.metres_per_unit == plan.unit else reading.scaled(scale.metres_per_unit / plan.unit)
    )


def _layers(plan: Plan) -> tuple[SourceLayer, ...]:
    """Return the file's classes with the length of what was set aside of each; of walls, of them all."""
    walls = sum(w.length for w in plan.walls)
    share = max(sum(role == "wall" for role in plan.layers.values()), 1)
    out = []
    for name, role in plan.layers.items():
        pieces = [p.line for p in plan.set_aside if f"({name})" in p.reason]
        length = walls / share if role == "wall" else sum(_length(line) for line in pieces)
        out.append(SourceLayer(name, role, "the class that the file itself gives", float(length)))
    return tuple(out)


def _length(line: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def _unknown() -> Finding:
    return Finding(
        "scale-unknown",
        "serious",
        "The file states no unit that its walls, doors and storeys agree with: coordinates are its own "
        "units. Give metres per unit.",
    )
