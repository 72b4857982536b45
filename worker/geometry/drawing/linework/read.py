"""Vector drawings to their reading: the one way from linework, whatever file it came from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.domain.findings import Finding
from worker.geometry.drawing.linework.areas import entity_area, tangled_areas
from worker.geometry.drawing.linework.guess import guess_walls
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.pairs import pair_lines
from worker.geometry.drawing.linework.removed import removed_strokes, source_layers
from worker.geometry.drawing.linework.roles import Roles, assign_roles
from worker.geometry.drawing.linework.units import assumed_unit
from worker.geometry.drawing.outline.solids import read_outlines
from worker.geometry.drawing.reading.reading import Column, Reading, Wall
from worker.geometry.drawing.scale.decision import Scale

Progress = Callable[[str, float], None]

_PIER_SIDE, _PIER_RATIO, _PIER_FILL = 1.5, 2.5, 0.6
_TOUCH = 0.03
_SAME_LINE, _MOSTLY = 0.03, 0.7
_SAMPLE = 0.1
_MOST_AREAS = 20_000


def read_linework(
    linework: Linework,
    *,
    scale: Scale,
    wall_layers: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Reading:
    """Return the reading of a vector drawing: walls with their exact faces, all else by role and reason.

    Walls are taken by a person's choice of layers, by classes, by the layers' names, or else by pen and
    geometry. Every line of the wall layers is a face of a wall: two that run side by side are the faces of
    one, a line without counterpart is a partition of thickness 0.

    Parameters
    ----------
    linework : Linework
        As its loader gave it.
    scale : Scale
        Metres a drawing unit; while it is unknown the reading is in drawing units.
    wall_layers : sequence of str, optional
        The layers that hold the walls, as a person chose them.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`: from the page's lower left corner where the file has a page, else model
        coordinates less `origin`.

    Raises
    ------
    InvalidRequest
        If wall layers were chosen and none of them is in the file.
    DrawingTooComplex
        If the lines lie so densely that they cannot be compared.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("walls", 0.0)
    unit = assumed_unit(linework, scale)
    frame = _Frame.of(linework, scale)
    roles = assign_roles(linework, wall_layers=wall_layers)
    guessed = not roles.walls_known
    if guessed:
        roles = guess_walls(
            linework, roles, metres_per_unit=unit, tell=lambda share: tell("walls", share / 2)
        )
    found = _read_walls(linework, roles, unit, lambda share: tell("walls", 0.5 + share * 0.4))
    tell("set aside", 0.9)
    to = frame.factor / unit
    walls = tuple(_moved(w, to, frame.shift) for w in found.walls)
    columns = tuple(Column(c.outline * to + frame.shift, c.kind) for c in found.columns)
    return Reading(
        walls=walls,
        columns=columns,
        removed=removed_strokes(linework, roles, kept=found.kept, place=frame.place),
        sheet=frame.sheet,
        scale=scale,
        style="filled" if found.filled else "outlined" if _paired(walls) else "single-line",
        findings=(*linework.findings, *roles.findings, *_remarks(linework, roles, found, guessed=guessed)),
        origin=frame.origin,
        layers=source_layers(linework, roles, frame.factor),
    )


@dataclass(frozen=True)
class _Frame:
    """Hold how drawing units become the reading's: times `factor`, plus `shift`."""

    factor: float
    shift: NDArray[np.float64]
    origin: tuple[float, float]
    sheet: tuple[float, float]

    @classmethod
    def of(cls, linework: Linework, scale: Scale) -> _Frame:
        factor = scale.metres_per_unit or 1.0
        if linework.sheet is not None:
            left, bottom, right, top = (v * factor for v in linework.sheet)
            corner = (left, bottom)
            return cls(factor, -np.array(corner), corner, (right - left, top - bottom))
        points = linework.ends.reshape(-1, 2) * factor
        if not len(points):
            points = np.array([(t.x, t.y) for t in linework.texts] or [(0.0, 0.0)]) * factor
        low, high = points.min(axis=0), points.max(axis=0)
        step = (
            1.0 if scale.metres_per_unit is not None else 10.0 ** np.floor(np.log10(max(np.ptp(high), 1.0)))
        )
        low = np.floor(low / step) * step
        size = high - low
        return cls(factor, -low, (float(low[0]), float(low[1])), (float(size[0]), float(size[1])))

    def place(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(points * self.factor + self.shift, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class _Found:
    walls: list[Wall]
    columns: list[Column]
    kept: NDArray[np.bool_]
    filled: bool


def _read_walls(linework: Linework, roles: Roles, unit: float, tell: Callable[[float], None]) -> _Found:
    """Return walls and columns [m by `unit`], and which entities they account for."""
    wanted = roles.entity == "wall"
    lined = wanted & ~linework.filled
    kept = np.zeros(len(linework.kind), dtype=np.bool_)
    columns: list[Column] = []
    piers = _piers(linework, lined, unit)
    for e, outline in piers.items():
        columns.append(Column(outline))
        kept[e] = True
    chosen = roles.entity == "column-kept"
    for e, outline in _outlines(linework, chosen, unit).items():
        columns.append(Column(outline))
        kept[e] = True
    lined |= chosen & ~linework.filled
    of = (lined & ~kept)[linework.entity]
    ends = linework.ends[of] * unit
    kept |= lined
    areas, drawn = _areas(linework, wanted & linework.filled, unit, ends)
    kept |= drawn
    walls = pair_lines(ends, tell=tell)
    if areas:
        solids = read_outlines(areas)
        walls += solids.walls
        columns += solids.columns
    return _Found(walls, columns, kept, filled=len(areas) > len(ends) / 8)


def _outlines(linework: Linework, which: NDArray[np.bool_], unit: float) -> dict[int, NDArray[np.float64]]:
    """Return the (K, 2) outlines [m] of the closed ones of some entities, by number."""
    first = np.searchsorted(linework.entity, np.arange(len(linework.kind) + 1))
    out = {}
    for e in np.flatnonzero(which).tolist():
        ring = linework.ends[first[e] : first[e + 1]]
        if len(ring) >= 3 and np.abs(ring[0, 0] - ring[-1, 1]).max() * unit < 1e-3:
            out[e] = ring[:, 0] * unit
    return out


def _piers(linework: Linework, lined: NDArray[np.bool_], unit: float) -> dict[int, NDArray[np.float64]]:
    """Return the closed compact outlines on wall layers that touch nothing else: columns."""
    compact = {}
    for e, outline in _outlines(linework, lined, unit).items():
        short, long = sorted(np.ptp(outline, axis=0))
        x, y = outline.T
        area = 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
        if 0 < long <= min(_PIER_SIDE, _PIER_RATIO * short) and area >= _PIER_FILL * short * long:
            compact[e] = outline
    if not compact:
        return {}
    of = lined[linework.entity]
    tree = shapely.STRtree(shapely.linestrings(linework.ends[of] * unit))
    owner = linework.entity[of]
    out = {}
    for e, outline in compact.items():
        near = tree.query(shapely.polygons(outline), predicate="dwithin", distance=_TOUCH)
        if (owner[near] == e).all():
            out[e] = outline
    return out


def _areas(
    linework: Linework, filled: NDArray[np.bool_], unit: float, ends: NDArray[np.float64]
) -> tuple[list[object], NDArray[np.bool_]]:
    """Return filled areas of wall layers whose outline no line repeats, and which entities these are."""
    drawn = np.zeros(len(linework.kind), dtype=np.bool_)
    which = np.flatnonzero(filled)
    samples = _samples(ends) if len(which) else np.zeros((0, 2))
    tree = cKDTree(samples) if len(samples) else None
    first = np.searchsorted(linework.entity, [which, which + 1]).T
    areas: list[object] = []
    for e, (low, high) in zip(which.tolist(), first.tolist(), strict=True):
        if len(areas) >= _MOST_AREAS:
            break
        if tree is not None and high > low:
            away = np.asarray(tree.query(_samples(linework.ends[low:high] * unit))[0])
            if np.mean(away <= _SAME_LINE + _SAMPLE / 2) >= _MOSTLY:
                continue
        area = entity_area(linework, e, unit)
        if area is not None:
            areas += list(shapely.get_parts(area))
            drawn[e] = True
    return areas, drawn


def _samples(ends: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points every 10 cm along (N, 2, 2) lines, at least one a line."""
    if not len(ends):
        return np.zeros((0, 2))
    step = ends[:, 1] - ends[:, 0]
    count = np.minimum(np.maximum(1, np.ceil(np.hypot(*step.T) / _SAMPLE)), 10_000).astype(np.int64)
    owner = np.repeat(np.arange(len(ends)), count)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    share = (within + 0.5) / count[owner]
    return np.asarray(ends[owner, 0] + step[owner] * share[:, None], dtype=np.float64)


def _moved(wall: Wall, factor: float, shift: NDArray[np.float64]) -> Wall:
    return Wall(
        wall.centre * factor + shift,
        wall.thickness * factor,
        (wall.faces[0] * factor + shift, wall.faces[1] * factor + shift),
        wall.kind,
        wall.confidence,
    )


def _paired(walls: Sequence[Wall]) -> bool:
    faced = sum(w.length for w in walls if w.thickness > 0)
    return faced >= 0.3 * sum(w.length for w in walls)


def _without_model(linework: Linework) -> bool:
    return any(f.code in {"only-references", "empty-model"} for f in linework.findings)


def _remarks(linework: Linework, roles: Roles, found: _Found, *, guessed: bool) -> list[Finding]:
    out = []
    is_empty = not found.walls and not found.columns
    if is_empty and not _without_model(linework):
        out.append(
            Finding(
                "no-walls",
                "serious",
                "Nothing in the drawing looks like a wall: no layer's name says so, and no lines run side by "
                "side at a wall's thickness. Choose the layers that hold the walls, or draw them by edits.",
                {"layers": list(linework.layer_names[:100])},
            )
        )
    elif guessed and not _without_model(linework):
        out.append(
            Finding(
                "wall-layers-guessed",
                "warning",
                "No layer's name says that it holds the walls; they were taken by pen and geometry. Look at "
                "the layers, and choose those of the walls where this is wrong.",
            )
        )
    columns = int((roles.entity == "column").sum())
    if columns:
        names = [n for n, r in zip(linework.layer_names, roles.layer_role, strict=True) if r == "column"]
        out.append(
            Finding(
                "columns-set-aside",
                "info",
                f"{columns} strokes stand on layers of columns and were set aside, since these are not wall "
                "layers: choose the layers, or move the strokes, to have them in the map.",
                {"layers": names[:50], "strokes": columns},
            )
        )
    return [*out, *tangled_areas(linework)]
