"""The program that cuts a building model: native code on an untrusted file, so in a process of its own.

It reads a request from standard input (one JSON object) and writes lines to standard output: ``p 0.3`` for
progress, and at last one JSON object, the answer or ``{"refused": leaf, "detail": ..., "members": ...}``. It
dies with its parent, and takes no more memory than the request allows.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib
import json
import os
import resource
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from worker.formats.ifc_classes import Element, Storey, elements_of, length_unit, storeys_of
from worker.geometry.drawing.model.mesh_cut import cut_mesh

LOW, HIGH = 0.1, 2.0
"""Furniture and the like are shown where they reach into this range above the floor [m]."""

_PR_SET_PDEATHSIG = 1
_MOST_WALLS = 4_000
_MOST_OTHERS = 1_500
_OTHERS_SECONDS = 8.0
_COARSE, _FINE = 0.05, 0.002
_FARTHEST = 1e9
_WALL_HEIGHT = (1.8, 9.0)
_UNITS = (1.0, 0.001, 0.01, 0.3048, 0.0254, 1000.0)
_WALLS = ("wall", "curtain")
_MATERIAL = (*_WALLS, "column")
_SHOWN = ("door", "window", "stair", "furniture", "other")


class Refused(Exception):
    """The model cannot be cut: which refusal, and why."""

    def __init__(self, leaf: str, detail: str, **members: Any) -> None:
        super().__init__(detail)
        self.answer = {"refused": leaf, "detail": detail, "members": members}


def main() -> int:
    """Answer the request on standard input; return 0 also where the model is refused."""
    argparse.ArgumentParser(
        description="The worker starts this for one building model; its request comes on standard input."
    ).parse_args()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    request = json.loads(sys.stdin.read())
    _limit(request["memory_bytes"], request["parent"])

    def tell(share: float) -> None:
        answers.write(f"p {share:.3f}\n")
        answers.flush()

    try:
        answer = cut_model(Path(request["path"]), request, tell)
    except Refused as refusal:
        answer = refusal.answer
    except MemoryError:
        answer = Refused("DrawingTooComplex", "needs more memory than is given to one model.").answer
    answers.write(json.dumps(answer) + "\n")
    answers.close()
    return 0


def cut_model(path: Path, request: dict[str, Any], tell: Callable[[float], None]) -> dict[str, Any]:
    """Return the cut of one storey as JSON values, in metres and world coordinates.

    Raises
    ------
    Refused
        With the leaf and the sentence for the person who sent the model.
    """
    model = _open(path)
    tell(0.1)
    unit, unit_name = length_unit(model)
    storeys = storeys_of(model, unit)
    elements = elements_of(model, storeys)
    for each in storeys:
        each.walls = len({e.group for e in elements if e.storey is each and e.role in _WALLS})
    storey = _choose(storeys, request.get("storey"), request.get("page"))
    if not any(e.role in _WALLS for e in elements):
        raise Refused("NoWallsFound", f"has no wall: it holds {_census(elements)}.")
    shaper = _Shaper(tell)
    _shape_walls(elements, storey, storeys, shaper)
    floor = _floor(elements, storey)
    heights = _wall_heights(elements, storey)
    metre = _metre(heights)
    cut = floor + float(request["cut_height_m"]) * metre
    items = [_section(e, cut) for e in elements if e.role in _MATERIAL and e.vertices is not None]
    _shape_others(elements, storey, shaper)
    items += [_shown(e) for e in elements if e.role in _SHOWN and _reaches(e, floor, cut)]
    return {
        "schema": str(model.schema),
        "unit": unit,
        "unit_name": unit_name,
        "metre": metre,
        "storeys": [s.to_json() for s in storeys],
        "storey": storeys.index(storey) if storey is not None else None,
        "floor": floor,
        "cut": cut,
        "items": items,
        "wall_heights": heights,
        "doors": [size for e in elements if e.role == "door" and (size := e.size) is not None],
        "failed": shaper.failed,
        "skipped": shaper.skipped,
    }


def _open(path: Path) -> Any:
    import ifcopenshell  # noqa: PLC0415 - native, and of an extra

    try:
        model = ifcopenshell.open(str(path))
    except (RuntimeError, OSError, ValueError, TypeError, KeyError) as error:
        why = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise Refused("FileMalformed", f"is no readable IFC model: {why}.") from error
    except ifcopenshell.Error as error:
        raise Refused("FileMalformed", f"is no readable IFC model: {str(error)[:200]}.") from error
    if not isinstance(model, ifcopenshell.file):
        raise Refused("UnsupportedMedia", "is not an IFC model in one STEP file.")
    return model


def _choose(storeys: list[Storey], name: str | None, page: int | None) -> Storey | None:
    """Return the storey that was asked for, or the only one with walls; None where the model has none."""
    listed = "; ".join(
        f"{i}: {s.name} ({s.elevation:.2f} m, {s.walls} walls)" for i, s in enumerate(storeys, 1)
    )
    pages = [{"page": i, **s.to_json()} for i, s in enumerate(storeys, 1)]
    if name is not None:
        named = [s for s in storeys if s.name.casefold() == name.casefold()]
        if len(named) == 1:
            return named[0]
        if not named:
            raise Refused("PageNotFound", f"has no storey {name!r}; it has {listed or 'none'}.", pages=pages)
        raise Refused("PageNeeded", f"has several storeys {name!r}; choose by number: {listed}.", pages=pages)
    if page is not None and (storeys or page != 1):
        if page > len(storeys):
            raise Refused("PageNotFound", f"has no storey {page}; it has {listed or 'none'}.", pages=pages)
        return storeys[page - 1]
    with_walls = [s for s in storeys if s.walls]
    if len(with_walls) > 1:
        raise Refused(
            "PageNeeded",
            f"has {len(with_walls)} storeys with walls; choose one by its name or number: {listed}.",
            pages=pages,
        )
    return with_walls[0] if with_walls else (storeys[0] if storeys else None)


class _Shaper:
    """Make triangles of elements, one by one, and count what cannot be shaped."""

    def __init__(self, tell: Callable[[float], None]) -> None:
        geom: Any = importlib.import_module("ifcopenshell.geom")
        self._create = geom.create_shape
        self._settings = {}
        for coarse in (False, True):
            settings = geom.settings()
            settings.set("use-world-coords", True)
            settings.set("mesher-linear-deflection", _COARSE if coarse else _FINE)
            settings.set("no-normals", True)
            self._settings[coarse] = settings
        self.tell = tell
        self.failed = 0
        self.skipped = 0

    def shape(self, element: Element, *, coarse: bool = False) -> None:
        """Give the element its vertices (V, 3) [m] and triangles (F, 3)."""
        try:
            shape = self._create(self._settings[coarse], element.entity)
        except (RuntimeError, ValueError, TypeError):
            self.failed += 1
            return
        vertices = np.array(shape.geometry.verts, dtype=np.float64).reshape(-1, 3)
        triangles = np.array(shape.geometry.faces, dtype=np.int64).reshape(-1, 3)
        if not len(triangles) or not (np.abs(vertices) < _FARTHEST).all():
            self.failed += 1
            return
        element.vertices, element.triangles = vertices, triangles


def _shape_walls(
    elements: list[Element], storey: Storey | None, storeys: list[Storey], shaper: _Shaper
) -> None:
    """Shape what may stand in the cut: of a very large model the storey's own, and those of the one below."""
    material = [e for e in elements if e.role in _MATERIAL]
    if storey is not None and len(material) > _MOST_WALLS:
        at = storeys.index(storey)
        near = [None, *storeys[max(at - 1, 0) : at + 1]]
        shaper.skipped += sum(e.storey not in near for e in material)
        material = [e for e in material if e.storey in near]
    for n, element in enumerate(material):
        if n % 20 == 0:
            shaper.tell(0.15 + 0.6 * n / len(material))
        shaper.shape(element)


def _floor(elements: list[Element], storey: Storey | None) -> float:
    """Return the height of the storey's floor: of the two that it states the one its walls stand on."""
    bases = [
        float(e.vertices[:, 2].min())
        for e in elements
        if e.role in _WALLS and e.vertices is not None and (e.storey is storey or storey is None)
    ]
    if storey is None:
        if not bases:
            raise Refused("NoWallsFound", "has walls, but none with a shape that can be made.")
        return min(bases)
    if not bases:
        return storey.placed
    return min((storey.placed, storey.elevation), key=lambda z: abs(z - float(np.median(bases))))


def _wall_heights(elements: list[Element], storey: Storey | None) -> list[float]:
    """Return how high the storey's walls are [m, if the stated unit is right]."""
    return [
        float(np.ptp(e.vertices[:, 2]))
        for e in elements
        if e.role in _WALLS and e.vertices is not None and (e.storey is storey or storey is None)
    ]


def _metre(heights: list[float]) -> float:
    """Return how long a metre is in the model's stated metres: 1, but where its walls are no walls then."""
    low, high = _WALL_HEIGHT
    middle = float(np.median(heights)) if heights else low
    fitting = [factor for factor in _UNITS if low <= middle / factor <= high]
    return fitting[0] if fitting and not middle < low <= max(heights) <= high else 1.0


def _section(element: Element, cut: float) -> dict[str, Any]:
    item = _described(element)
    low, high = item["z"]
    if element.vertices is None or element.triangles is None or not low < cut < high:
        item["hull"] = _hull(element)
        return item
    rings, lines = cut_mesh(element.vertices, element.triangles, cut)
    item["rings"] = [r.tolist() for r in rings]
    item["lines"] = [x.tolist() for x in lines]
    return item


def _shape_others(elements: list[Element], storey: Storey | None, shaper: _Shaper) -> None:
    """Shape doors, windows, stairs and furniture of the storey, as far as the time for it reaches."""
    others = [e for e in elements if e.role in _SHOWN and (e.storey is storey or e.storey is None)]
    others.sort(key=lambda e: _SHOWN.index(e.role))
    until = _cpu_seconds() + _OTHERS_SECONDS
    for n, element in enumerate(others):
        if n % 20 == 0:
            shaper.tell(0.75 + 0.2 * n / len(others))
        if n >= _MOST_OTHERS or _cpu_seconds() > until:
            shaper.skipped += len(others) - n
            break
        shaper.shape(element, coarse=True)


def _reaches(element: Element, floor: float, cut: float) -> bool:
    if element.vertices is None:
        return False
    low, high = float(element.vertices[:, 2].min()), float(element.vertices[:, 2].max())
    return low < max(floor + HIGH, cut) and high > floor + LOW


def _shown(element: Element) -> dict[str, Any]:
    return {**_described(element), "hull": _hull(element)}


def _described(element: Element) -> dict[str, Any]:
    z = element.vertices[:, 2] if element.vertices is not None else np.zeros(1)
    return {
        "id": element.group,
        "class": element.ifc_class,
        "role": element.role,
        "own": element.storey is not None,
        "storey": element.storey.name if element.storey is not None else None,
        "z": [float(z.min()), float(z.max())],
    }


def _hull(element: Element) -> list[list[float]]:
    import shapely  # noqa: PLC0415

    if element.vertices is None:
        return []
    hull = shapely.convex_hull(shapely.MultiPoint(element.vertices[:, :2]))
    return np.asarray(shapely.get_coordinates(hull)).tolist()  # type: ignore[no-any-return] # shapely is untyped


def _census(elements: list[Element]) -> str:
    counts: dict[str, int] = {}
    for element in elements:
        counts[element.ifc_class] = counts.get(element.ifc_class, 0) + 1
    most = sorted(counts.items(), key=lambda kv: (-kv[1], kv[0]))[:6]
    return ", ".join(f"{n} {name}" for name, n in most) or "no building element"


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _limit(memory_bytes: int, parent: int) -> None:
    """Take no more memory than that, leave no core file, and die with the parent."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = memory_bytes if hard == resource.RLIM_INFINITY else min(memory_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
