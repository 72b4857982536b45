"""Vector pages (PDF, SVG) to their reading: walls by pen, by pairs of strokes, and by filled areas."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.errors import DrawingTooComplex, NoWallsFound
from service.domain.findings import Finding
from worker.geometry.drawing.linework.areas import tangled_areas
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.read import read_linework
from worker.geometry.drawing.linework.removed import source_layers
from worker.geometry.drawing.linework.roles import Roles, assign_roles
from worker.geometry.drawing.linework.units import assumed_unit
from worker.geometry.drawing.outline.solids import Solids, read_outlines
from worker.geometry.drawing.page.areas import wall_areas
from worker.geometry.drawing.page.removed import frames, set_aside
from worker.geometry.drawing.page.sheet import draw_page
from worker.geometry.drawing.page.strips import Strips, find_pen_strips
from worker.geometry.drawing.raster.read import read_raster
from worker.geometry.drawing.reading.reading import Column, Reading, Wall
from worker.geometry.drawing.scale.decision import Scale, given

Progress = Callable[[str, float], None]

_NOT_WALLS = ("door", "window", "text", "dimension", "hatch", "furniture", "stair", "frame", "grid")
_LEAST_PEN, _LIGHTEST, _LEAST_BESIDE = 0.3, 0.7, 0.4
_SAME_PEN = 0.02
_DOOR, _LEAST_CLUSTER, _NEIGHBOUR = 0.85, 0.25, 0.8
_LEAST_PAIRED, _LEAST_LENGTH = 0.2, 8.0
_FRAME_SHARE, _FRAME_HOLE, _FRAME_SIDES = 0.8, 0.5, 8
_PX_M, _MOST_PIXELS = 0.015, 60_000_000


def read_page(
    linework: Linework,
    *,
    scale: Scale,
    wall_layers: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Reading:
    """Return the reading of a vector page.

    Where layers tell which lines are walls, they are read as those of any vector drawing. Else the pens are
    compared by how much of their strokes runs in pairs at a wall's thickness: the walls are the material
    between such pairs and the filled areas of their shape, as far as it hangs together. A page whose walls
    are neither is drawn to pixels and read as a scanned one.

    Parameters
    ----------
    linework : Linework
        A page, as its loader gave it.
    scale : Scale
        Metres a drawing unit; while it is unknown the reading is in drawing units.
    wall_layers : sequence of str, optional
        The layers that hold the walls, as a person chose them.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`, from the page's lower left corner.

    Raises
    ------
    InvalidRequest
        If wall layers were chosen and none of them is in the file.
    NoWallsFound
        If nothing on the page looks like a wall.
    DrawingTooComplex
        If the lines of the wall layers lie so densely that they cannot be compared.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("walls", 0.0)
    roles = assign_roles(linework, wall_layers=wall_layers)
    if roles.walls_known:
        return read_linework(_unmasked(linework), scale=scale, wall_layers=wall_layers, progress=progress)
    unit = assumed_unit(linework, scale)
    material = _find_material(linework, roles, unit, tell)
    solids = _main_parts(material.areas, _size(linework, unit), tell)
    if material.is_enough and sum(w.length for w in solids.walls) >= _LEAST_LENGTH:
        return _vector_reading(linework, roles, scale, unit, (material, solids))
    return _pixel_reading(linework, roles, scale, unit, tell)


@dataclass(frozen=True, eq=False)
class _Material:
    """Hold what walls are made of: areas [m], the entities that drew them, and whether that explains the pen.

    `pens` names the chosen pens for people.
    """

    areas: list[Any]
    kept: NDArray[np.bool_]
    pens: tuple[str, ...]
    is_enough: bool
    is_filled: bool


def _unmasked(linework: Linework) -> Linework:
    """Return the page without the white areas that hide others."""
    seen = linework.kind[linework.entity] != "mask"
    return replace(linework, ends=linework.ends[seen], entity=linework.entity[seen])


def _find_material(linework: Linework, roles: Roles, unit: float, tell: Progress) -> _Material:
    """Return the material of walls: strips of the wall pens and filled areas."""
    areas, kept = wall_areas(linework, unit)
    solid = sum(a.length / 2 for a in areas)
    strips: dict[int, Strips] = {}
    pens = _pens(linework, roles)
    for done, number in enumerate(pens):
        tell("walls", 0.1 + 0.3 * done / len(pens))
        with suppress(DrawingTooComplex):  # a pen that lies so densely draws hatches
            strips[number] = find_pen_strips(linework.ends[pens[number].of] * unit)
    chosen = _wall_pens(pens, strips, _size(linework, unit))
    if sum(strips[n].paired / 2 for n in chosen) < _LEAST_BESIDE * solid:
        chosen = []
    texts = np.array([(t.x * unit, t.y * unit) for t in linework.texts], dtype=np.float64).reshape(-1, 2)
    paired = drawn = 0.0
    for number in chosen:
        found = _without_texts(strips[number], texts)
        areas += list(found.areas)
        paired, drawn = paired + found.paired, drawn + found.drawn
        kept[np.unique(linework.entity[pens[number].of])] = True
    is_filled = solid > paired / 2
    is_enough = is_filled or (drawn > 0 and paired >= _LEAST_PAIRED * drawn)
    return _Material(areas, kept, tuple(pens[n].name for n in chosen), is_enough, is_filled)


@dataclass(frozen=True, eq=False)
class _PenStrokes:
    """Hold the strokes of one pen: which segments, how wide [mm], and its name for people."""

    of: NDArray[np.bool_]
    width: float
    name: str


def _pens(linework: Linework, roles: Roles) -> dict[int, _PenStrokes]:
    """Return the pens that may draw walls: undashed strokes, not on a layer that is named otherwise."""
    may = ~linework.filled & ~linework.dashed & ~np.isin(roles.entity, _NOT_WALLS)
    may &= np.isin(linework.kind, ["line", "polyline", "spline"])
    width = np.where(np.isnan(linework.width), 0.0, linework.width)
    keys = np.stack([linework.layer, np.rint(width / _SAME_PEN), linework.colour.astype(np.int64)], axis=1)
    _, pen, count = np.unique(keys.astype(np.int64), axis=0, return_inverse=True, return_counts=True)
    pen = pen.reshape(-1)
    out = {}
    for number in np.argsort(-count)[:40]:
        of = (may & (pen == number))[linework.entity]
        if of.sum() >= 2:
            first = int(np.flatnonzero(pen == number)[0])
            layer = linework.layer_names[linework.layer[first]] if linework.layer_names else ""
            name = f"{width[first]:.2f} mm, #{int(linework.colour[first]):06x}"
            out[int(number)] = _PenStrokes(of, float(width[first]), f"{layer}: {name}" if layer else name)
    return out


def _wall_pens(
    pens: dict[int, _PenStrokes], strips: dict[int, Strips], page: tuple[float, float]
) -> list[int]:
    """Return the pens that draw walls: the one that is paired most, and others as heavy and as good.

    What runs along most of a side of the page is its frame, and speaks for no pen.
    """
    good = {}
    for number, found in strips.items():
        inside = found.length < _FRAME_SHARE * min(page)
        paired = 2.0 * float(found.length[inside].sum())
        drawn = found.drawn - (found.paired - paired)
        good[number] = paired**2 / drawn if drawn > 0 else 0.0
    if not good or max(good.values()) <= 0:
        return []
    best = max(good, key=lambda n: good[n])
    lightest = _LIGHTEST * pens[best].width - 1e-9
    return [n for n in good if good[n] >= _LEAST_PEN * good[best] and pens[n].width >= lightest]


def _without_texts(strips: Strips, texts: NDArray[np.float64]) -> Strips:
    """Return the strips in which no text stands: boxes of room numbers and rows of tables are no walls."""
    if not len(strips.areas) or not len(texts):
        return strips
    tree = shapely.STRtree(strips.areas)
    hit = np.unique(tree.query(shapely.points(texts), predicate="within")[1])
    kept = np.ones(len(strips.areas), dtype=np.bool_)
    kept[hit] = False
    return replace(strips, areas=strips.areas[kept], length=strips.length[kept])


def _main_parts(areas: list[Any], page: tuple[float, float], tell: Progress) -> Solids:
    """Return walls and columns of the material that hangs together over doors; frames and tables fall out.

    Each part that has a quarter of the largest one's walls is a plan of its own, and what lies within the
    box around these, or next to it, belongs to them.
    """
    if not areas:
        return Solids((), ())
    tell("walls", 0.5)
    bodies = np.array(areas, dtype=np.object_)
    grown = shapely.buffer(bodies, _DOOR, join_style="mitre", mitre_limit=1.5)
    parts = shapely.get_parts(shapely.union_all(grown))
    tree = shapely.STRtree(parts)
    of, part = tree.query(
        shapely.points([a.representative_point().coords[0] for a in areas]), predicate="within"
    )
    size = np.zeros(len(parts))
    np.add.at(size, part, np.array([areas[i].length / 2 for i in of]))
    spread = np.array([min(p.bounds[2] - p.bounds[0], p.bounds[3] - p.bounds[1]) for p in parts])
    size[spread < 3 * _DOOR] = 0.0  # a single line of material is no plan
    count = np.bincount(part, minlength=len(parts))
    may = np.ones(len(parts), dtype=np.bool_)
    for k in _frame_parts(parts, page):
        inside = tree.query(shapely.Polygon(parts[k].exterior), predicate="contains_properly")
        bare = count[k] <= _FRAME_SIDES and len(parts[k].interiors) == 1
        if bare or (size[inside] >= _LEAST_LENGTH).any():
            size[k], may[k] = 0.0, False
    main = _with_neighbours((size >= _LEAST_CLUSTER * size.max()) & (size > 0), may, parts)
    chosen = [areas[i] for i, k in zip(of, part, strict=True) if main[k]]
    tell("walls", 0.6)
    return read_outlines(chosen)


def _with_neighbours(
    main: NDArray[np.bool_], may: NDArray[np.bool_], parts: NDArray[np.object_]
) -> NDArray[np.bool_]:
    """Return the main parts with those that lie in the box around them, or next to a part that does."""
    while main.any():
        box = shapely.box(*shapely.total_bounds(parts[main]))
        kept = shapely.union_all(parts[main])
        near = shapely.contains(box, parts) | shapely.dwithin(parts, kept, _NEIGHBOUR)
        grown = main | (near & may)
        if (grown == main).all():
            break
        main = grown
    return main


def _frame_parts(parts: NDArray[np.object_], page: tuple[float, float]) -> list[int]:
    """Return which parts run around nearly the whole page, as a frame does and with it its title block."""
    out = []
    for k, part in enumerate(parts):
        box = part.bounds
        around = box[2] - box[0] >= _FRAME_SHARE * page[0] and box[3] - box[1] >= _FRAME_SHARE * page[1]
        hole = max((shapely.Polygon(r).area for r in part.interiors), default=0.0)
        if around and hole >= _FRAME_HOLE * page[0] * page[1]:
            out.append(k)
    return out


def _vector_reading(
    linework: Linework, roles: Roles, scale: Scale, unit: float, found: tuple[_Material, Solids]
) -> Reading:
    material, solids = found
    factor = scale.metres_per_unit or 1.0
    walls = tuple(_scaled(w, factor / unit) for w in solids.walls)
    columns = tuple(replace(c, outline=c.outline * (factor / unit)) for c in solids.columns)
    kept = _used(linework, material.kept, unit, solids)
    corner = np.array(linework.sheet[:2] if linework.sheet is not None else (0.0, 0.0))
    pens = "; ".join(material.pens) or "filled areas alone"
    finding = Finding(
        "walls-by-pen",
        "info",
        f"No layer tells the walls: they were taken by pen and geometry ({pens}).",
        {"pens": list(material.pens), "filled": material.is_filled},
    )
    return Reading(
        walls=walls,
        columns=columns,
        removed=set_aside(_unmasked(linework), roles, kept=kept, place=lambda p: (p - corner) * factor),
        sheet=_size(linework, factor),
        scale=scale,
        style="filled" if material.is_filled else "outlined",
        findings=(*linework.findings, finding, *tangled_areas(linework)),
        layers=source_layers(linework, roles, factor) if any(linework.layer_names) else (),
    )


def _used(linework: Linework, chosen: NDArray[np.bool_], unit: float, solids: Solids) -> NDArray[np.bool_]:
    """Return which of the entities of the wall pens really run along a wall or column that was kept."""
    lines = [f for w in solids.walls for f in w.faces] + [
        np.vstack([c.outline, c.outline[:1]]) for c in solids.columns
    ]
    kept = np.zeros(len(linework.kind), dtype=np.bool_)
    if not lines:
        return kept
    tree = shapely.STRtree([shapely.linestrings(line) for line in lines])
    segments = np.flatnonzero(chosen[linework.entity])
    middle = shapely.points(linework.ends[segments].mean(axis=1) * unit)
    near = np.unique(tree.query(middle, predicate="dwithin", distance=0.05)[0])
    kept[np.unique(linework.entity[segments[near]])] = True
    return kept


def _size(linework: Linework, factor: float) -> tuple[float, float]:
    left, bottom, right, top = linework.sheet or (0.0, 0.0, 1.0, 1.0)
    return ((right - left) * factor, (top - bottom) * factor)


def _scaled(wall: Wall, factor: float) -> Wall:
    faces = (wall.faces[0] * factor, wall.faces[1] * factor)
    return replace(wall, centre=wall.centre * factor, thickness=wall.thickness * factor, faces=faces)


def _pixel_reading(linework: Linework, roles: Roles, scale: Scale, unit: float, tell: Progress) -> Reading:
    """Return the page drawn to pixels, without texts, dashes and hatches, and read as a scanned one."""
    drawn = ~np.isin(roles.entity, _NOT_WALLS) & ~linework.dashed & (linework.kind != "mask")
    drawn &= ~frames(linework)
    if not drawn.any():
        raise NoWallsFound("Nothing is drawn on the page but texts, dashes and hatches: choose another page.")
    sheet = draw_page(linework, drawn, units_per_px=_PX_M / unit, most_pixels=_MOST_PIXELS)
    per_px = sheet.units_per_px * unit
    reading = read_raster(
        sheet.grey, scale=given(per_px), progress=lambda stage, share: tell(stage, 0.5 + 0.5 * share)
    )
    factor = (scale.metres_per_unit or 1.0) / unit
    left, bottom = linework.sheet[:2] if linework.sheet is not None else (0.0, 0.0)
    shift = np.array([sheet.origin[0] - left, sheet.origin[1] - bottom]) * unit
    finding = Finding(
        "page-read-as-pixels",
        "info",
        "The strokes of the page neither run in pairs nor fill areas as walls do: it was drawn to pixels "
        f"of {per_px * 100:.1f} cm and read as a scanned sheet, without its texts.",
    )
    others = set_aside(
        _unmasked(linework), roles, kept=drawn, place=lambda p: (p - (left, bottom)) * unit * factor
    )
    moved = _shifted(reading, shift, factor)
    return replace(
        moved,
        removed=(*moved.removed, *others),
        sheet=_size(linework, unit * factor),
        scale=scale,
        findings=(*linework.findings, finding, *reading.findings),
        layers=source_layers(linework, roles, unit * factor) if any(linework.layer_names) else (),
    )


def _shifted(reading: Reading, shift: NDArray[np.float64], factor: float) -> Reading:
    """Return a reading moved by `shift`, then with every coordinate and length times `factor`."""

    def move(line: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(line + shift, dtype=np.float64)

    walls = tuple(
        replace(w, centre=move(w.centre), faces=(move(w.faces[0]), move(w.faces[1]))) for w in reading.walls
    )
    columns = tuple(Column(move(c.outline), c.kind) for c in reading.columns)
    removed = tuple(replace(r, lines=tuple(move(x) for x in r.lines)) for r in reading.removed)
    moved = replace(reading, walls=walls, columns=columns, removed=removed)
    return moved if math.isclose(factor, 1.0) else moved.scaled(factor)
