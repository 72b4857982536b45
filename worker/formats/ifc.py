"""IFC building models: a storey cut at a height above its floor, and its walls by class."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import (
    DrawingTooComplex,
    FileMalformed,
    FileTruncated,
    NoWallsFound,
    UnsupportedMedia,
)
from service.domain.findings import Finding, Severity
from service.domain.scale_hint import ScaleHint
from worker.formats.ifc_process import ask_kernel
from worker.geometry.drawing.model.plan import Piece, Plan, plan_reading
from worker.geometry.drawing.model.sections import area_of
from worker.geometry.drawing.outline.solids import Solids, read_outlines
from worker.geometry.drawing.reading.reading import Column, Reading, Wall
from worker.geometry.drawing.scale.decision import USUAL_UNITS, Scale, Witness, contradictions, decide

CUT_HEIGHT = 1.2
"""Where a storey is cut unless it is said [m above its floor]."""

_DOOR_REACH = 0.35
_WIDEST_GLAZING = 0.6
_HEAD, _TAIL = b"ISO-10303-21;", b"END-ISO-10303-21;"
_LOOKED_AT = 65_536
_DOOR_WIDTH, _DOOR_HEIGHT = (0.5, 3.0), (1.7, 3.2)
_WALL_THICKNESS = (0.03, 1.2)
_WALL_HEIGHT = (1.5, 12.0)
_STOREY_HEIGHT = (2.1, 6.0)
_REASONS = {
    "door": "a door of the model ({cls}): its opening stays open",
    "window": "a window of the model ({cls}) at the height of the cut",
    "stair": "a stair or ramp of the model ({cls})",
    "furniture": "furniture or a fitting of the model ({cls})",
    "other": "of a class that is no wall ({cls})",
}

_REMARKS = {
    "windows-open": "windows at the height of the cut are gaps in the walls; a lower cut closes those "
    "with a sill.",
    "curtain-walls": "curtain walls are read as walls; a LiDAR may look through their glass.",
    "doors-cut-out": "doors have no opening of their own and were cut out of the walls.",
    "elements-without-shape": "elements have a shape that cannot be made; they are missing.",
    "elements-left-out": "elements were left out: the model is very large.",
}


def load_ifc(
    path: Path,
    *,
    bounds: Bounds | None = None,
    storey: str | None = None,
    page: int | None = None,
    cut_height_m: float | None = None,
    hint: ScaleHint | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Reading:
    """Return the walls of one storey of an IFC model, as a horizontal cut shows them.

    Walls, curtain walls and columns are what the cut goes through, whichever storey they are listed under;
    walls that touch are one body, as one sees it. Door and window openings at that height are gaps, and so is
    a door that has no opening of its own. Everything else is set aside by its class.

    Parameters
    ----------
    path : Path
        An IFC-SPF file (IFC2X3, IFC4, IFC4X3).
    bounds : Bounds, optional
        The most that is read.
    storey : str, optional
        Name of the storey, upper or lower case.
    page : int, optional
        Or its number from the lowest, counted from 1. Neither is needed where only one storey has walls.
    cut_height_m : float, optional
        Above the storey's floor; 1.2 m where it is not said.
    hint : ScaleHint, optional
        A person's word on the scale; it wins over the unit that the model states.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`: model coordinates minus `origin`.

    Raises
    ------
    UnsupportedMedia
        If it is no IFC model, or the extra ``ifc`` is not installed.
    FileTruncated
        If the file does not end as a STEP file ends.
    FileMalformed
        If it cannot be parsed, or the geometry kernel crashes on it.
    DrawingTooComplex
        If it is larger, or takes more time or memory, than `bounds` give.
    PageNeeded
        If several storeys have walls and none was chosen; `pages` lists them.
    PageNotFound
        If the model has no such storey.
    NoWallsFound
        If the cut goes through no wall.
    """
    bounds = bounds or Bounds()
    tell = progress or (lambda _stage, _share: None)
    _check(path, bounds)
    answer = ask_kernel(
        path,
        bounds=bounds,
        cut_height_m=CUT_HEIGHT if cut_height_m is None else cut_height_m,
        storey=storey,
        page=page,
        progress=lambda share: tell("cut", 0.8 * share),
    )
    _to_metres(answer)
    tell("walls", 0.85)
    try:
        solids, lines, doors_cut = _material(answer["items"])
    except shapely.errors.ShapelyError as error:
        raise FileMalformed(f"The cut through {path.name} makes no outlines: {error}.") from error
    if not solids.walls and not lines:
        raise NoWallsFound(_nothing_cut(path, answer))
    scale = _scale(answer, solids, hint)
    plan = Plan(
        walls=(*solids.walls, *(Wall.of(x, thickness=0.0, kind="partition") for x in lines)),
        columns=solids.columns,
        set_aside=_set_aside(answer),
        layers=_layer_roles(answer["items"]),
        findings=(*_findings(answer, doors_cut), *contradictions(scale)),
        unit=(answer["unit"] or 1.0) / answer["metre"],
    )
    return plan_reading(plan, scale)


def _check(path: Path, bounds: Bounds) -> None:
    """Refuse what is no whole IFC file, before any native code sees it."""
    size = path.stat().st_size
    if size > bounds.max_model_bytes:
        raise DrawingTooComplex(
            f"{path.name} has {size >> 20} MiB; at most {bounds.max_model_bytes >> 20} are read. Export the "
            "one storey that is needed, without furniture and fittings.",
            max_bytes=bounds.max_model_bytes,
        )
    with path.open("rb") as file:
        head = file.read(_LOOKED_AT)
        file.seek(max(0, size - 512))
        tail = file.read()
    if not head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_HEAD):
        raise UnsupportedMedia(f"{path.name} does not begin as an IFC model (ISO-10303-21).")
    if not tail.rstrip(b"\0 \t\r\n\x1a").endswith(_TAIL):
        raise FileTruncated(
            f"{path.name} does not end with {_TAIL.decode()} as an IFC file does: the copy or the upload was "
            "cut short. Upload it again."
        )
    schema = head.find(b"FILE_SCHEMA")
    if schema >= 0 and b"IFC" not in head[schema : schema + 400].upper():
        raise UnsupportedMedia(f"{path.name} is a STEP model of another schema than IFC; export it as IFC.")
    if importlib.util.find_spec("ifcopenshell") is None:
        raise UnsupportedMedia(
            "IFC models need the extra 'ifc' of the worker, which is not installed here: "
            "pip install 'groundplan[worker,ifc]'. Or export the floor as DXF or PDF."
        )


def _to_metres(answer: dict[str, Any]) -> None:
    """Divide every length by the likely metre: 1, but where the stated unit makes walls that are none."""
    metre = answer["metre"]
    for item in answer["items"]:
        for name in ("rings", "lines"):
            item[name] = [np.array(line) / metre for line in item[name]] if name in item else []
        item["hull"] = np.array(item.get("hull") or np.zeros((0, 2))) / metre
        item["z"] = [z / metre for z in item["z"]]
    for storey in answer["storeys"]:
        storey["elevation_m"] /= metre
    answer["wall_heights"] = [h / metre for h in answer["wall_heights"]]
    answer["floor"], answer["cut"] = answer["floor"] / metre, answer["cut"] / metre


def _material(items: list[dict[str, Any]]) -> tuple[Solids, list[NDArray[np.float64]], int]:
    """Return walls and columns of the cut, open lines of surface models, and how many doors cut a wall."""
    walls: list[Any] = []
    columns: list[Any] = []
    lines: list[NDArray[np.float64]] = []
    glazing: dict[int, list[Any]] = {}
    for item in items:
        area = area_of(item["rings"])
        lines += [line for line in item["lines"] if len(line) >= 2]
        if item["role"] == "curtain":
            glazing.setdefault(item["id"], []).append(area)
        else:
            (columns if item["role"] == "column" else walls).append(area)
    walls += [_glazed(areas) for areas in glazing.values()]
    walls, doors_cut = _without_doors([a for a in walls if not a.is_empty], items)
    solids = read_outlines(walls)
    outlines = [p for area in columns for p in shapely.get_parts(area) if p.area > 0]
    own = tuple(Column(np.asarray(p.exterior.coords)[:-1, :2].copy()) for p in outlines)
    return Solids(solids.walls, solids.columns + own), lines, doors_cut


def _glazed(areas: list[Any]) -> Any:
    """Return a curtain wall's panes and posts as one body: the rectangle around them where it is straight."""
    whole = shapely.union_all(areas)
    box = shapely.minimum_rotated_rectangle(whole)
    if box.geom_type == "Polygon":
        corners = np.asarray(box.exterior.coords)[:3]
        short, _long = sorted(np.hypot(*np.diff(corners, axis=0).T))
        along = shapely.buffer(whole, short, cap_style="flat", join_style="mitre")
        if short <= _WIDEST_GLAZING and shapely.intersection(along, box).area > 0.999 * box.area:
            return shapely.intersection(box, along)
    closed = shapely.buffer(whole, 0.06, join_style="mitre", mitre_limit=2.0)
    return shapely.buffer(closed, -0.06, join_style="mitre", mitre_limit=2.0)


def _without_doors(walls: list[Any], items: list[dict[str, Any]]) -> tuple[list[Any], int]:
    """Return walls with doors cut out that have no opening of their own, and how many these were."""
    tree = shapely.STRtree(walls)
    count = 0
    for item in items:
        if item["role"] != "door" or len(item["hull"]) < 3:
            continue
        box = shapely.minimum_rotated_rectangle(shapely.MultiPoint(item["hull"]))
        near = tree.query(box, predicate="intersects")
        covered = sum(shapely.intersection(walls[k], box).area for k in near)
        if box.area > 0 and covered > 0.5 * box.area:
            count += 1
            grown = _across(box)
            for k in near:
                walls[k] = shapely.difference(walls[k], grown)
    return [w for w in walls if not w.is_empty], count


def _across(box: Any) -> Any:
    """Return a door's rectangle made wide enough to cut through the wall that it stands in."""
    corners = np.asarray(box.exterior.coords)[:4]
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    first = int(np.argmin(sides))
    a, b, c, d = np.roll(corners, -first, axis=0)
    step = (b - a) / max(float(sides[first]), 1e-9) * _DOOR_REACH
    if sides[first] < 1e-9:
        normal = np.array([-(d - a)[1], (d - a)[0]])
        step = normal / np.hypot(*normal) * _DOOR_REACH
    return shapely.Polygon([a - step, b + step, c + step, d - step])


def _set_aside(answer: dict[str, Any]) -> tuple[Piece, ...]:
    out = []
    for item in answer["items"]:
        hull = item["hull"]
        if len(hull) < 2:
            continue
        role, cls = item["role"], item["class"]
        if role in _REASONS:
            out.append(Piece(hull, role, _REASONS[role].format(cls=cls)))
        elif role != "curtain" and item["own"] and item["storey"] == _storey_name(answer):
            low, high = (z - answer["floor"] for z in item["z"])
            reason = f"a {role} ({cls}) from {low:.2f} to {high:.2f} m above the floor: the cut passes it by"
            out.append(Piece(hull, "other", reason))
    return tuple(out)


def _storey_name(answer: dict[str, Any]) -> str | None:
    at = answer["storey"]
    return None if at is None else str(answer["storeys"][at]["name"])


def _layer_roles(items: Iterable[dict[str, Any]]) -> dict[str, str]:
    roles = {item["class"]: item["role"] for item in items}
    return {cls: "wall" if role == "curtain" else role for cls, role in sorted(roles.items())}


def _scale(answer: dict[str, Any], solids: Solids, hint: ScaleHint | None) -> Scale:
    """Return the scale: the stated unit, held against doors, walls and storeys."""
    unit = answer["unit"]
    witnesses = []
    if unit:
        detail = f"The model states its unit of length: {answer['unit_name']}."
        witnesses.append(Witness("file-unit", unit, unit, detail))
    per_unit = (unit or 1.0) / answer["metre"]
    doors = np.array(answer["doors"]).reshape(-1, 2)
    if len(doors):
        width, height = (float(v) for v in np.median(doors, axis=0))
        low = max(_DOOR_WIDTH[0] / width, _DOOR_HEIGHT[0] / height)
        high = min(_DOOR_WIDTH[1] / width, _DOOR_HEIGHT[1] / height)
        detail = f"{len(doors)} doors state {width:g} x {height:g} units in the middle."
        witnesses += [Witness("door-size", low, high, detail, len(doors))] if low <= high else []
    thick = [w.thickness / per_unit for w in solids.walls if w.thickness > 0.0]
    witnesses += _range("wall-spacing", thick, _WALL_THICKNESS, "walls, thick")
    tall = [h / per_unit for h in answer["wall_heights"]]
    witnesses += _range("wall-height", tall, _WALL_HEIGHT, "walls, high")
    heights = np.diff(sorted(s["elevation_m"] / per_unit for s in answer["storeys"]))
    witnesses += _range(
        "storey-height", [float(h) for h in heights if h > 0.0], _STOREY_HEIGHT, "storeys, high"
    )
    units = sorted({*USUAL_UNITS.values(), *([unit] if unit else [])})
    return decide(witnesses, hint=hint, units=units)


def _range(kind: str, sizes: list[float], metres: tuple[float, float], what: str) -> list[Witness]:
    """Return what the middle of some sizes [units] allows, if buildings have them within `metres`."""
    if not sizes:
        return []
    middle = float(np.median(sizes))
    detail = f"{len(sizes)} {what}: {middle:g} units in the middle."
    return [Witness(kind, metres[0] / middle, metres[1] / middle, detail, len(sizes))]


def _findings(answer: dict[str, Any], doors_cut: int) -> list[Finding]:
    items = answer["items"]
    cut = answer["cut"] - answer["floor"]
    name = _storey_name(answer)
    above = [s["name"] for i, s in enumerate(answer["storeys"]) if i != answer["storey"]]
    out = [
        Finding(
            "storey-cut",
            "info",
            f"The storey {name!r} was cut {cut:.2f} m above its floor"
            + (f"; the model also has {', '.join(map(repr, above[:8]))}." if above else "."),
            {"storey": name, "floor_m": round(answer["floor"], 4), "cut_height_m": round(cut, 4)},
        )
    ]
    counts = {
        "windows-open": sum(i["role"] == "window" for i in items),
        "curtain-walls": len({i["id"] for i in items if i["role"] == "curtain"}),
        "doors-cut-out": doors_cut,
        "elements-without-shape": answer["failed"],
        "elements-left-out": answer["skipped"],
    }
    for code, count in counts.items():
        if count:
            severity: Severity = "warning" if code.startswith("elements") else "info"
            out.append(Finding(code, severity, f"{count} {_REMARKS[code]}", {"count": count}))
    return out


def _nothing_cut(path: Path, answer: dict[str, Any]) -> str:
    spans = [i["z"] for i in answer["items"] if i["role"] in ("wall", "curtain")]
    if not spans:
        return f"None of the walls in {path.name} has a shape that can be made."
    low, high = min(s[0] for s in spans), max(s[1] for s in spans)
    floor = answer["floor"]
    return (
        f"At {answer['cut'] - floor:.2f} m above the floor of {_storey_name(answer)!r} the cut goes through "
        f"no wall: the model's walls reach from {low - floor:.2f} to {high - floor:.2f} m above it. Choose "
        "another height or storey."
    )
