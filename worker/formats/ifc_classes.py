"""What the classes of a building model mean on a floor plan, and which storey an element belongs to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

_ROLES: tuple[tuple[str, str], ...] = (
    ("IfcWall", "wall"),
    ("IfcCurtainWall", "curtain"),
    ("IfcColumn", "column"),
    ("IfcDoor", "door"),
    ("IfcWindow", "window"),
    ("IfcStair", "stair"),
    ("IfcStairFlight", "stair"),
    ("IfcRamp", "stair"),
    ("IfcRampFlight", "stair"),
    ("IfcFurnishingElement", "furniture"),
    ("IfcFlowTerminal", "furniture"),
    ("IfcDistributionElement", "other"),
    ("IfcTransportElement", "other"),
    ("IfcRailing", "other"),
    ("IfcCovering", "other"),
    ("IfcMember", "other"),
    ("IfcPlate", "other"),
    ("IfcBuildingElementPart", "other"),
    ("IfcBuildingElementProxy", "other"),
)
_OF_PARENT = ("wall", "curtain", "column", "stair")
_DEEPEST = 12
_FEET = 0.3048


@dataclass(eq=False)
class Storey:
    """Hold a storey: its name, the height it states and the one it is placed at [m], and its walls."""

    key: int
    name: str
    elevation: float
    placed: float
    walls: int = 0

    def to_json(self) -> dict[str, Any]:
        """Return the storey as a JSON object."""
        return {"name": self.name, "elevation_m": round(self.elevation, 4), "walls": self.walls}


@dataclass(eq=False)
class Element:
    """Hold an element that may show on the plan, and its shape once it is made.

    Parameters
    ----------
    entity : ifcopenshell.entity_instance
    ifc_class, role : str
        Its class, and what it is on a plan; a part has the role of what it is a part of.
    group : int
        The id of the whole that it is a part of, or its own.
    storey : Storey or None
    size : tuple of float, optional
        Stated width and height of a door [the model's unit].
    vertices, triangles : ndarrays of shape (V, 3) [m] and (F, 3), optional
    """

    entity: Any
    ifc_class: str
    role: str
    group: int
    storey: Storey | None
    size: tuple[float, float] | None = None
    vertices: NDArray[np.float64] | None = None
    triangles: NDArray[np.int64] | None = None


def length_unit(model: Any) -> tuple[float, str]:
    """Return metres a length unit of the model, and the unit's name; 0 and a reason where none is stated."""
    import ifcopenshell.util.unit  # noqa: PLC0415

    try:
        unit = ifcopenshell.util.unit.get_project_unit(model, "LENGTHUNIT")
        scale = float(ifcopenshell.util.unit.calculate_unit_scale(model))
    except (RuntimeError, AttributeError, IndexError, TypeError, ValueError, ZeroDivisionError):
        return 0.0, "no unit of length is stated"
    if unit is None or not np.isfinite(scale) or not scale > 0.0:
        return 0.0, "no unit of length is stated"
    prefix = getattr(unit, "Prefix", None)
    return scale, f"{prefix or ''}{unit.Name}".lower()


def storeys_of(model: Any, unit: float) -> list[Storey]:
    """Return the storeys from the lowest to the highest."""
    import ifcopenshell.util.placement  # noqa: PLC0415

    metres = unit or 1.0
    out = []
    for entity in model.by_type("IfcBuildingStorey"):
        try:
            matrix = ifcopenshell.util.placement.get_local_placement(entity.ObjectPlacement)
            placed = float(matrix[2][3]) * metres
        except (RuntimeError, AttributeError, IndexError, TypeError, ValueError, RecursionError):
            placed = float("nan")
        stated = getattr(entity, "Elevation", None)
        elevation = float(stated) * metres if stated is not None else placed
        placed = placed if np.isfinite(placed) else elevation
        elevation = elevation if np.isfinite(elevation) else placed
        if not np.isfinite(elevation):
            elevation = placed = 0.0
        name = str(entity.Name or entity.LongName or f"storey #{entity.id()}")[:120]
        out.append(Storey(entity.id(), name, elevation, placed))
    return sorted(out, key=lambda s: (s.elevation, s.placed, s.name))


def elements_of(model: Any, storeys: list[Storey]) -> list[Element]:
    """Return what may show on a plan and has a shape."""
    by_key = {s.key: s for s in storeys}
    out = []
    for entity in model.by_type("IfcElement"):
        if entity.Representation is None:
            continue
        role, group = _role(entity)
        if role is None:
            continue
        size = _size(entity) if role == "door" else None
        storey = _storey(entity, by_key)
        out.append(Element(entity, entity.is_a(), role, group, storey, size))
    return out


def _role(entity: Any) -> tuple[str | None, int]:
    """Return what an element is on a plan, and the id of the whole it belongs to."""
    own = _own_role(entity)
    if own not in (None, "other"):
        return own, entity.id()
    at = entity
    for _ in range(_DEEPEST):
        at = _parent(at)
        if at is None:
            break
        role = _own_role(at)
        if role in _OF_PARENT:
            return role, at.id()
    return own, entity.id()


def _own_role(entity: Any) -> str | None:
    for name, role in _ROLES:
        if entity.is_a(name):
            return role
    return None


def _parent(entity: Any) -> Any:
    for relation in ("Decomposes", "Nests"):
        for link in getattr(entity, relation, None) or ():
            return link.RelatingObject
    return None


def _storey(entity: Any, by_key: dict[int, Storey]) -> Storey | None:
    """Return the storey that contains an element, itself or through what it is a part of or fills."""
    at = entity
    for _ in range(_DEEPEST):
        if at is None:
            return None
        if at.id() in by_key:
            return by_key[at.id()]
        contained = getattr(at, "ContainedInStructure", None) or ()
        if contained:
            at = contained[0].RelatingStructure
            continue
        fills = getattr(at, "FillsVoids", None) or ()
        if fills and _parent(at) is None:
            voids = fills[0].RelatingOpeningElement.VoidsElements
            at = voids[0].RelatingBuildingElement if voids else None
            continue
        at = _parent(at)
    return None


def _size(entity: Any) -> tuple[float, float] | None:
    width, height = (getattr(entity, name, None) for name in ("OverallWidth", "OverallHeight"))
    if width is None or height is None or not (0 < width < 1e6 and 0 < height < 1e6):
        return None
    return float(width), float(height)
