"""Small IFC models with known walls, written entity by entity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.guid

Ring = Sequence[tuple[float, float]]

UNITS = {"mm": ("MILLI", 0.001), "cm": ("CENTI", 0.01), "m": (None, 1.0)}


@dataclass
class Solid:
    """Hold an upright solid of a class: its outline [m], and the heights of foot and top above the storey."""

    ifc_class: str
    ring: Ring
    low: float = 0.0
    high: float = 2.8
    openings: list[tuple[Ring, float, float]] = field(default_factory=list)


def bar(x0: float, y0: float, x1: float, y1: float) -> Ring:
    """Return the corners of a rectangle."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


class ModelWriter:
    """Write storeys of solids as an IFC4 model; lengths are given in metres and written in `unit`."""

    def __init__(self, unit: str = "mm", *, placed: bool = True) -> None:
        self.file: Any = ifcopenshell.file(schema="IFC4")
        self.unit = unit
        self.placed = placed
        self.metres = 0.3048 if unit == "ft" else UNITS[unit][1]
        make = self.file.create_entity
        self.world = make("IfcAxis2Placement3D", self._point(0, 0, 0))
        self.context = make(
            "IfcGeometricRepresentationContext",
            ContextType="Model", CoordinateSpaceDimension=3, Precision=1e-6, WorldCoordinateSystem=self.world,
        )  # fmt: skip
        self.project = make(
            "IfcProject",
            GlobalId=ifcopenshell.guid.new(), Name="p",
            RepresentationContexts=[self.context],
            UnitsInContext=make("IfcUnitAssignment", [self._length_unit()]),
        )  # fmt: skip
        self.building = make(
            "IfcBuilding", GlobalId=ifcopenshell.guid.new(), ObjectPlacement=self._place(None, 0.0)
        )
        self._whole(self.project, [self.building])

    def storey(self, name: str, elevation: float, solids: Sequence[Solid]) -> None:
        """Add a storey at an elevation [m] with its solids."""
        placement = self._place(self.building.ObjectPlacement, elevation if self.placed else 0.0)
        storey = self.file.create_entity(
            "IfcBuildingStorey",
            GlobalId=ifcopenshell.guid.new(), Name=name, ObjectPlacement=placement,
            Elevation=elevation / self.metres,
        )  # fmt: skip
        self._whole(self.building, [storey])
        lift = 0.0 if self.placed else elevation
        products = [self._product(solid, placement, lift) for solid in solids]
        if products:
            self.file.create_entity(
                "IfcRelContainedInSpatialStructure",
                GlobalId=ifcopenshell.guid.new(), RelatedElements=products, RelatingStructure=storey,
            )  # fmt: skip

    def write(self, path: Path) -> Path:
        """Write the model."""
        self.file.write(str(path))
        return path

    def _product(self, solid: Solid, placement: Any, lift: float) -> Any:
        product = self.file.create_entity(
            solid.ifc_class,
            GlobalId=ifcopenshell.guid.new(),
            ObjectPlacement=self._place(placement, 0.0),
            Representation=self._shape(solid.ring, solid.low + lift, solid.high + lift),
        )
        if solid.ifc_class == "IfcDoor":
            xs, ys = zip(*solid.ring, strict=True)
            product.OverallWidth = max(max(xs) - min(xs), max(ys) - min(ys)) / self.metres
            product.OverallHeight = (solid.high - solid.low) / self.metres
        for ring, low, high in solid.openings:
            opening = self.file.create_entity(
                "IfcOpeningElement",
                GlobalId=ifcopenshell.guid.new(),
                ObjectPlacement=self._place(placement, 0.0),
                Representation=self._shape(ring, low + lift, high + lift),
            )
            self.file.create_entity(
                "IfcRelVoidsElement", ifcopenshell.guid.new(), None, None, None, product, opening
            )
        return product

    def _shape(self, ring: Ring, low: float, high: float) -> Any:
        make = self.file.create_entity
        points = [make("IfcCartesianPoint", (x / self.metres, y / self.metres)) for x, y in [*ring, ring[0]]]
        profile = make("IfcArbitraryClosedProfileDef", "AREA", None, make("IfcPolyline", points))
        base = make("IfcAxis2Placement3D", self._point(0, 0, low))
        up = make("IfcDirection", (0.0, 0.0, 1.0))
        body = make("IfcExtrudedAreaSolid", profile, base, up, (high - low) / self.metres)
        shape = make("IfcShapeRepresentation", self.context, "Body", "SweptSolid", [body])
        return make("IfcProductDefinitionShape", None, None, [shape])

    def _place(self, relative: Any, z: float) -> Any:
        axes = self.file.create_entity("IfcAxis2Placement3D", self._point(0, 0, z))
        return self.file.create_entity("IfcLocalPlacement", relative, axes)

    def _point(self, x: float, y: float, z: float) -> Any:
        return self.file.create_entity("IfcCartesianPoint", tuple(float(v) / self.metres for v in (x, y, z)))

    def _length_unit(self) -> Any:
        make = self.file.create_entity
        if self.unit == "ft":
            metre = make("IfcSIUnit", None, "LENGTHUNIT", None, "METRE")
            measure = make("IfcMeasureWithUnit", make("IfcLengthMeasure", 0.3048), metre)
            none = make("IfcDimensionalExponents", 1, 0, 0, 0, 0, 0, 0)
            return make("IfcConversionBasedUnit", none, "LENGTHUNIT", "FOOT", measure)
        return make("IfcSIUnit", None, "LENGTHUNIT", UNITS[self.unit][0], "METRE")

    def _whole(self, whole: Any, parts: list[Any]) -> None:
        self.file.create_entity("IfcRelAggregates", ifcopenshell.guid.new(), None, None, None, whole, parts)


def small_house(unit: str = "mm") -> ModelWriter:
    """Return a 10 x 6 m house: outer walls 0.3 m, one partition of 0.1 m with a door, a window, a column."""
    model = ModelWriter(unit)
    model.storey("Ground", 0.0, house_solids())
    return model


def house_solids() -> list[Solid]:
    """Return the house's solids, in metres."""
    south = Solid("IfcWall", bar(0, 0, 10, 0.3), openings=[(bar(7, -0.1, 8.5, 0.4), 0.9, 2.1)])
    partition = Solid("IfcWall", bar(5, 0.3, 5.1, 5.7), openings=[(bar(4.9, 2, 5.2, 2.9), 0.0, 2.1)])
    return [
        south,
        Solid("IfcWall", bar(0, 5.7, 10, 6)),
        Solid("IfcWall", bar(0, 0.3, 0.3, 5.7)),
        Solid("IfcWall", bar(9.7, 0.3, 10, 5.7)),
        partition,
        Solid("IfcColumn", bar(7.5, 3, 7.9, 3.4)),
        Solid("IfcDoor", bar(5.02, 2, 5.08, 2.9), high=2.1),
        Solid("IfcWindow", bar(7, 0.1, 8.5, 0.2), low=0.9, high=2.1),
        Solid("IfcFurniture", bar(1, 1, 2.6, 1.8), high=0.75),
        Solid("IfcStair", bar(1, 3, 2, 5.5), high=2.8),
        Solid("IfcSlab", bar(0, 0, 10, 6), low=-0.3, high=0.0),
    ]
