"""Open-RMF `building.yaml`: a floor plan that a person has annotated in the traffic editor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileMalformed,
    NotFinite,
    NoWallsFound,
    PageNeeded,
    PageNotFound,
    TooManyPoints,
    UnsupportedMedia,
)
from service.domain.findings import Finding
from service.domain.scale_hint import ScaleHint
from worker.formats.plain_yaml import parse_plain_yaml
from worker.geometry.drawing.model.chains import chain_lines
from worker.geometry.drawing.model.geodesy import local_metres
from worker.geometry.drawing.model.plan import Piece, Plan, plan_reading
from worker.geometry.drawing.reading.reading import Reading, Wall
from worker.geometry.drawing.scale.decision import (
    AGREEMENT,
    USUAL_UNITS,
    Scale,
    Witness,
    contradictions,
    decide,
)

WALL_THICKNESS = 0.1
"""Open-RMF's own tools build walls of this thickness [m] around the annotated line; the file states none."""

_IMAGE, _METRES, _WGS84 = "reference_image", "cartesian_meters", "wgs84"
_FARTHEST = 1e9
_DOOR_WIDTH = (0.55, 4.0)
_EXTENT = (4.0, 2000.0)
_CROSS = 0.25
_WIDEST_DEGREES = 0.1
_ROLES = {
    "walls": "wall",
    "doors": "door",
    "lanes": "other",
    "measurements": "dimension",
    "floors": "other",
    "models": "furniture",
}


@dataclass(frozen=True, eq=False)
class _Level:
    """Hold one level in the file's units, y up."""

    name: str
    vertices: NDArray[np.float64]
    walls: NDArray[np.int64]
    doors: NDArray[np.int64]
    lanes: NDArray[np.int64]
    measured: NDArray[np.int64]
    lengths: NDArray[np.float64]
    floors: tuple[NDArray[np.int64], ...] = ()
    models: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2)))

    def span(self, edges: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the lengths of (K, 2) edges [units]."""
        ends = self.vertices[edges]
        return np.asarray(np.hypot(*(ends[:, 1] - ends[:, 0]).T), dtype=np.float64)

    def measurements(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what was measured, drawn [units] and real [m]; without those that measure nothing."""
        drawn = self.span(self.measured)
        usable = (drawn > 0.0) & (self.lengths > 0.0)
        return drawn[usable], self.lengths[usable]


def load_building_yaml(
    path: Path,
    *,
    bounds: Bounds | None = None,
    page: int | None = None,
    storey: str | None = None,
    hint: ScaleHint | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Reading:
    """Return the walls that a person drew on one level of a building, with the scale of its measurements.

    Parameters
    ----------
    path : Path
        The file.
    bounds : Bounds, optional
        The most that is read.
    page : int, optional
        Number of the level in the file's order, counted from 1; not needed where there is one.
    storey : str, optional
        Or its name.
    hint : ScaleHint, optional
        A person's word on the scale; it wins over the file's measurements.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`: x right, y up; the file's coordinates (of an image: y turned up) minus `origin`.

    Raises
    ------
    FileMalformed
        If it is no building file, or an edge names a vertex that is not there.
    NotFinite
        If a coordinate or a distance is not a finite number.
    DrawingTooComplex, TooManyPoints
        If it is larger than is read.
    UnsupportedMedia
        If its coordinates are of a system that is not read.
    PageNeeded, PageNotFound
        If a level has to be chosen, or the chosen one does not exist.
    NoWallsFound
        If the level has no walls.
    """
    bounds = bounds or Bounds()
    tell = progress or (lambda _stage, _share: None)
    with path.open("rb") as file:
        text = file.read(bounds.max_yaml_bytes + 1)
    tell("load", 0.1)
    building = parse_plain_yaml(text, path.name, bounds=bounds)
    system = _system(building, path)
    levels = building.get("levels")
    if not isinstance(levels, dict) or not levels:
        raise FileMalformed(f"{path.name} has no levels; an Open-RMF building has at least one.")
    level = _level(*_choose(levels, page, storey, path), system, bounds, path)
    tell("walls", 0.7)
    if not len(level.walls):
        raise NoWallsFound(f"The level {level.name!r} of {path.name} has no walls.")
    scale = _scale(level, system, hint)
    plan = _plan(level, scale)
    findings = (*plan.findings, *_findings(level, system, scale), *contradictions(scale))
    reading = plan_reading(replace(plan, findings=findings), scale)
    return replace(reading, top=-reading.origin[1]) if system == _IMAGE else reading


def _system(building: dict[str, Any], path: Path) -> str:
    system = building.get("coordinate_system", _IMAGE)
    if system not in (_IMAGE, _METRES, _WGS84):
        raise UnsupportedMedia(
            f"The coordinates of {path.name} are of the system {str(system)[:40]!r}; {_IMAGE}, {_METRES} and "
            f"{_WGS84} are read. Save the building in one of these."
        )
    return str(system)


def _choose(levels: dict[Any, Any], page: int | None, storey: str | None, path: Path) -> tuple[str, Any]:
    names = [str(name)[:120] for name in levels]
    counts = [len(v.get("walls") or ()) if isinstance(v, dict) else 0 for v in levels.values()]
    pages = [
        {"page": i, "name": n, "walls": c} for i, (n, c) in enumerate(zip(names, counts, strict=True), 1)
    ]
    listed = "; ".join(f"{p['page']}: {p['name']} ({p['walls']} walls)" for p in pages[:20])
    if storey is not None:
        at = [i for i, n in enumerate(names) if n.casefold() == storey.casefold()]
        if not at:
            raise PageNotFound(f"{path.name} has no level {storey!r}; it has {listed}.", pages=pages)
        page = at[0] + 1
    if page is None:
        if len(names) > 1:
            raise PageNeeded(
                f"{path.name} has {len(names)} levels; choose one by its number or name: {listed}.",
                pages=pages,
            )
        page = 1
    if not 1 <= page <= len(names):
        raise PageNotFound(f"{path.name} has no level {page}; it has {listed}.", pages=pages)
    return names[page - 1], list(levels.values())[page - 1]


def _level(name: str, value: Any, system: str, bounds: Bounds, path: Path) -> _Level:
    where = f"the level {name!r} of {path.name}"
    if not isinstance(value, dict):
        raise FileMalformed(f"What stands for {where} is no mapping.")
    rows = _list(value, "vertices", where)
    if len(rows) > bounds.max_walls:
        raise TooManyPoints(
            f"There are {len(rows)} vertices in {where}; at most {bounds.max_walls} are read."
        )
    points = np.array([_point(row, f"vertex {i} in {where}") for i, row in enumerate(rows)]).reshape(-1, 2)
    models = [
        (_number(m.get("x"), where), _number(m.get("y"), where))
        for m in _list(value, "models", where)
        if isinstance(m, dict)
    ]
    both = np.vstack([points, np.array(models).reshape(-1, 2)])
    both = _in_units(both, system, where)
    edges = {
        kind: _edges(value, kind, len(points), where) for kind in ("walls", "doors", "lanes", "measurements")
    }
    return _Level(
        name,
        both[: len(points)],
        edges["walls"],
        edges["doors"],
        edges["lanes"],
        edges["measurements"],
        _lengths(value, where),
        tuple(_floor(f, len(points), where) for f in _list(value, "floors", where)),
        both[len(points) :],
    )


def _in_units(xy: NDArray[np.float64], system: str, where: str) -> NDArray[np.float64]:
    """Return positions in the file's units, x right and y up; of longitude and latitude in metres."""
    if system != _WGS84:
        return xy * (1.0, -1.0 if system == _IMAGE else 1.0)
    if len(xy) and (np.abs(xy).max(axis=0) > (180.0, 85.0)).any():
        raise FileMalformed(f"A position of {where} is no longitude and latitude within 85 degrees.")
    if len(xy) and np.ptp(xy, axis=0).max() > _WIDEST_DEGREES:
        raise FileMalformed(f"The positions of {where} reach over more than {_WIDEST_DEGREES:g} degrees.")
    return local_metres(xy) if len(xy) else xy


def _list(value: dict[str, Any], name: str, where: str) -> list[Any]:
    found = value.get(name)
    if found is None:
        return []
    if not isinstance(found, list):
        raise FileMalformed(f"The {name} of {where} are no list.")
    return found


def _point(row: Any, where: str) -> tuple[float, float]:
    if not isinstance(row, list) or len(row) < 2:
        raise FileMalformed(f"The {where} is no list [x, y, z, name].")
    return _number(row[0], where), _number(row[1], where)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FileMalformed(f"A coordinate or length of {where} is no number: {str(value)[:40]!r}.")
    if not math.isfinite(value):
        raise NotFinite(f"A coordinate or length of {where} is not a finite number.")
    if abs(value) > _FARTHEST:
        raise FileMalformed(f"A coordinate or length of {where} is {value:g}, beyond any building.")
    return float(value)


def _edges(value: dict[str, Any], kind: str, vertices: int, where: str) -> NDArray[np.int64]:
    out = []
    for number, row in enumerate(_list(value, kind, where)):
        ends = row[:2] if isinstance(row, list) and len(row) >= 2 else [None]
        if not all(isinstance(i, int) and not isinstance(i, bool) and 0 <= i < vertices for i in ends):
            raise FileMalformed(
                f"Entry {number} of the {kind} of {where} does not join two of the {vertices} vertices."
            )
        out.append(ends)
    return np.array(out, dtype=np.int64).reshape(-1, 2)


def _floor(value: Any, vertices: int, where: str) -> NDArray[np.int64]:
    ring = value.get("vertices") if isinstance(value, dict) else None
    if not isinstance(ring, list) or not all(isinstance(i, int) and 0 <= i < vertices for i in ring):
        raise FileMalformed(f"A floor of {where} is no list of its {vertices} vertices.")
    return np.array(ring, dtype=np.int64)


def _lengths(value: dict[str, Any], where: str) -> NDArray[np.float64]:
    """Return the distances [m] that the measurements state, as ``{distance: [3, 8.4]}``."""
    out = []
    for number, row in enumerate(_list(value, "measurements", where)):
        said = row[2].get("distance") if len(row) > 2 and isinstance(row[2], dict) else None
        length = said[-1] if isinstance(said, list) and said else said
        out.append(_number(length, f"measurement {number} of {where}"))
    return np.array(out, dtype=np.float64)


def _scale(level: _Level, system: str, hint: ScaleHint | None) -> Scale:
    """Return the scale: of an image by its measurements (least squares), else the system's metre."""
    doors = level.span(level.doors)
    doors = doors[doors > 0.0]
    witnesses: list[Witness] = []
    if len(doors):
        width = float(np.median(doors))
        detail = f"{len(doors)} doors, {width:.4g} units wide in the middle."
        witnesses.append(
            Witness("door-size", _DOOR_WIDTH[0] / width, _DOOR_WIDTH[1] / width, detail, len(doors))
        )
    if system != _IMAGE:
        extent = float(np.ptp(level.vertices[level.walls.ravel()], axis=0).max())
        detail = f"The walls reach over {extent:.4g} units."
        witnesses.append(
            Witness("extent", _EXTENT[0] / max(extent, 1e-9), _EXTENT[1] / max(extent, 1e-9), detail)
        )
        witnesses.append(Witness("file-unit", 1.0, 1.0, f"The file's coordinates are {system}: metres."))
        return decide(witnesses, hint=hint, units=tuple(USUAL_UNITS.values()))
    drawn, lengths = level.measurements()
    witnesses += [
        Witness(
            "measured-length",
            real / d,
            real / d,
            f"A measurement in the file: {real:g} m over {d:.1f} units.",
        )
        for d, real in zip(drawn.tolist(), lengths.tolist(), strict=True)
    ]
    scale = decide(witnesses, hint=hint)
    if scale.state != "found" or scale.metres_per_unit is None:
        return scale
    fits = np.abs(lengths / drawn / scale.metres_per_unit - 1.0) <= AGREEMENT
    fitted = float((drawn[fits] * lengths[fits]).sum() / (drawn[fits] ** 2).sum())
    return replace(scale, metres_per_unit=fitted, candidates=(fitted, *scale.candidates[1:]))


def _plan(level: _Level, scale: Scale) -> Plan:
    """Return the level in metres where the scale is known, else in units and as mere lines."""
    factor = scale.metres_per_unit
    xy = level.vertices * (factor or 1.0)
    lines = chain_lines(xy, level.walls)
    if factor is None:
        walls = tuple(Wall.of(line, thickness=0.0, kind="partition") for line in lines)
    else:
        walls = tuple(Wall.of(line, thickness=WALL_THICKNESS) for line in lines)
    pieces = [
        Piece(xy[e], "door", "a door of the building file (doors): its opening stays open")
        for e in level.doors
    ]
    pieces += [Piece(xy[e], "other", "a lane for robots (lanes)") for e in level.lanes]
    pieces += [Piece(xy[e], "dimension", "a measured length (measurements)") for e in level.measured]
    pieces += [
        Piece(xy[np.append(f, f[:1])], "other", "the outline of a floor (floors)")
        for f in level.floors
        if len(f) > 1
    ]
    reach = _CROSS if factor is not None else 10.0
    for x, y in level.models * (factor or 1.0):
        cross = np.array([(x - reach, y), (x + reach, y)])
        pieces.append(Piece(cross, "furniture", "where a model stands, its size is not told (models)"))
    return Plan(walls, set_aside=tuple(pieces), layers=_ROLES, unit=factor or 1.0, style="single-line")


def _findings(level: _Level, system: str, scale: Scale) -> list[Finding]:
    out = [
        Finding(
            "wall-thickness-assumed",
            "info",
            f"The building file tells where walls run and not how thick they are: {WALL_THICKNESS:g} m is "
            "taken, as Open-RMF's own tools do.",
        )
    ]
    if system != _IMAGE:
        return out
    drawn, lengths = level.measurements()
    if empty := len(level.lengths) - len(lengths):
        out.append(
            Finding(
                "measurements-empty",
                "warning",
                f"{empty} of the file's {len(level.lengths)} measurements are left out: they have no length "
                "above 0, or join two vertices in the same place.",
                {"count": empty},
            )
        )
    if scale.metres_per_unit is not None and len(drawn):
        off = lengths / drawn / scale.metres_per_unit - 1.0
        worst = float(np.abs(off).max())
        out.append(
            Finding(
                "measurements-compared",
                "warning" if worst > AGREEMENT else "info",
                f"The file's {len(drawn)} measurements agree with the scale within {100 * worst:.2f} %.",
                {"deviation_shares": [round(float(v), 5) for v in off[:50]]},
            )
        )
    return out
