"""Occupancy grids against the plans that they were made from: every cell is what the plan says of it."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from PIL import Image
from shapely import affinity

from service.domain.drawing_options import DrawingOptions
from service.domain.region import Region
from service.domain.scale_hint import ScaleHint
from tests.geometry import generated_plans
from worker.formats.drawing import read_drawing_file
from worker.geometry.cloud.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid, occupancy_grid
from worker.geometry.drawing.reading.bodies import JOINT, solid_of, wall_body
from worker.geometry.drawing.reading.reading import Column, Reading, Wall

WIDE, HIGH = 8.0, 6.0
RESOLUTIONS = (0.02, 0.05, 0.1, 0.2)
HALF_DIAGONAL = math.sqrt(0.5)
SAG = 1.0 - math.sqrt(0.75) + 0.01
"""How deep a disc of 1 m reaches into the door of 1 m that leads out [m]: what is enclosed ends there."""


def a_plan(thickness: float, degrees: float) -> tuple[Any, Any, Any]:
    """Return the material, the outline and the inner doors of three rooms; a door leads out of one."""
    inner = min(thickness, 0.15)
    solid = shapely.union_all(
        [
            shapely.box(0, 0, WIDE, HIGH).difference(
                shapely.box(thickness, thickness, WIDE - thickness, HIGH - thickness)
            ),
            shapely.box(3, 0.01, 3 + inner, HIGH - 0.01),
            shapely.box(3 + inner / 2, 2.5, WIDE - 0.01, 2.5 + inner),
        ]
    )
    doors = [shapely.box(3, 3.6, 3 + inner, 4.5), shapely.box(5, 2.5, 5.9, 2.5 + inner)]
    gaps = [*(d.buffer(0.01, join_style="mitre") for d in doors), shapely.box(1, -1, 2, thickness + 0.01)]
    whole = (
        solid.difference(shapely.union_all(gaps)),
        shapely.box(0, 0, WIDE, HIGH),
        shapely.union_all(doors),
    )
    a, b, c = (affinity.rotate(shape, degrees, origin=(0, 0)) for shape in whole)
    return a, b, c


def read_dxf(material: Any, path: Path, style: str) -> Reading:
    """Return the reading of a DXF that shows the faces of walls as `lines`, or as `closed` outlines."""
    doc = ezdxf.new()
    doc.header["$INSUNITS"] = 6
    doc.layers.add("A-WALL")
    on = {"layer": "A-WALL"}
    for part in shapely.get_parts(material):
        for ring in (part.exterior, *part.interiors):
            corners = list(ring.coords)
            if style == "closed":
                doc.modelspace().add_lwpolyline(corners[:-1], close=True, dxfattribs=on)
                continue
            for a, b in pairwise(corners):
                doc.modelspace().add_line(a, b, dxfattribs=on)
    doc.saveas(path)
    return read_drawing_file(path, options=DrawingOptions())


class Cells:
    """Compare a grid with shapes: which cells lie in one, by their middles."""

    def __init__(self, grid: OccupancyGrid) -> None:
        rows, columns = grid.cells.shape
        x = grid.origin[0] + (np.arange(columns) + 0.5) * grid.resolution
        y = grid.origin[1] + (rows - np.arange(rows) - 0.5) * grid.resolution
        self.x, self.y = np.meshgrid(x, y)
        self.grey, self.reach = grid.cells, HALF_DIAGONAL * grid.resolution + 0.002

    def within(self, shape: Any) -> NDArray[np.bool_]:
        """Return which cells have their middles in a shape."""
        shapely.prepare(shape)
        return np.asarray(shapely.contains_xy(shape, self.x, self.y), dtype=np.bool_)

    def shades(self, cells: NDArray[np.bool_]) -> set[int]:
        """Return the greys of the cells."""
        return set(np.unique(self.grey[cells]).tolist())


@pytest.mark.parametrize("style", ["lines", "closed"])
@pytest.mark.parametrize(("thickness", "degrees"), [(0.08, 17), (0.3, 0), (0.3, 45), (0.45, 8), (0.6, 30)])
def test_every_cell_is_what_the_plan_says(
    tmp_path: Path, thickness: float, degrees: float, style: str
) -> None:
    material, outline, doors = a_plan(thickness, degrees)
    reading = read_dxf(material, tmp_path / "plan.dxf", style)
    faces = np.vstack([face for wall in reading.walls for face in wall.faces])
    x, y = faces.min(axis=0) - shapely.bounds(material)[:2]
    material, outline, doors = (affinity.translate(s, x, y) for s in (material, outline, doors))
    for resolution in RESOLUTIONS:
        cells = Cells(occupancy_grid(reading.walls, reading.columns, resolution=resolution))
        touched = cells.within(material.buffer(cells.reach))
        assert cells.shades(cells.within(material)) <= {OCCUPIED}, "wall bodies are solid"
        assert cells.shades(~cells.within(outline.buffer(cells.reach))) == {UNKNOWN}, "nobody drew outside"
        assert cells.shades(cells.within(doors) & ~touched) <= {FREE}, "doors are open"
        rooms = cells.within(outline.buffer(-SAG)) & ~touched
        assert cells.shades(rooms) == {FREE}, "rooms are free"


@pytest.mark.parametrize("style", ["filled", "outlined"])
@pytest.mark.parametrize("seed", [1, 2])
def test_bodies_of_pictures_are_solid(tmp_path: Path, style: str, seed: int) -> None:
    plan = generated_plans.draw_plan(style, seed)
    Image.fromarray(plan.grey).save(tmp_path / "plan.png")
    scale = ScaleHint(metres_per_unit=generated_plans.SCALE)
    reading = read_drawing_file(tmp_path / "plan.png", options=DrawingOptions(scale=scale))
    surely = plan.body.buffer(-2 * generated_plans.SCALE)
    for resolution in RESOLUTIONS:
        cells = Cells(occupancy_grid(reading.walls, reading.columns, resolution=resolution))
        assert cells.shades(cells.within(surely)) <= {OCCUPIED}
        for a, b in plan.doors:
            middle = shapely.LineString([a, b]).centroid.buffer(0.25)
            assert cells.shades(cells.within(middle)) <= {FREE, UNKNOWN}


def wall_with(faces: tuple[list[tuple[float, float]], list[tuple[float, float]]], thickness: float) -> Wall:
    left, right = (np.array(face, dtype=float) for face in faces)
    centre = np.array([(left[0] + right[0]) / 2, (left[-1] + right[-1]) / 2])
    return Wall(centre, thickness, (left, right))


def test_faces_of_different_points_enclose_one_body() -> None:
    plain = wall_with(([(0, 0.3), (4, 0.3)], [(0, 0), (4, 0)]), 0.3)
    more = wall_with(([(0, 0.3), (1, 0.3), (1.5, 0.3), (4, 0.3)], [(0, 0), (3.5, 0), (4, 0)]), 0.3)
    assert shapely.equals(wall_body(plain), wall_body(more))
    grids = [occupancy_grid([w], resolution=0.05) for w in (plain, more)]
    assert np.array_equal(grids[0].cells, grids[1].cells)
    assert int((grids[0].cells == OCCUPIED).sum()) >= 0.3 * 4.0 / 0.05**2


@pytest.mark.parametrize("turned", [False, True])
def test_a_wall_that_runs_round_is_a_ring(*, turned: bool) -> None:
    angle = np.linspace(0, 2 * np.pi, 65)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    inner = np.roll(circle[:-1], 9, axis=0)
    inner = np.vstack([inner, inner[:1]])[:: -1 if turned else 1]
    wall = Wall(3.0 * circle, 0.4, (2.8 * inner, 3.2 * circle))
    cells = Cells(occupancy_grid([wall], resolution=0.05))
    radius = np.hypot(cells.x, cells.y)
    assert cells.shades((radius > 2.81) & (radius < 3.18)) == {OCCUPIED}
    assert cells.shades(radius < 2.7) == {FREE}
    assert cells.shades(radius > 3.3) == {UNKNOWN}


def test_columns_are_solid() -> None:
    square = np.array([(2.0, 2.0), (2.8, 2.0), (2.8, 2.8), (2.0, 2.8)])
    around = [Wall.of(np.array(line, dtype=float), thickness=0.2) for line in SQUARE]
    cells = Cells(occupancy_grid(around, [Column(square)], resolution=0.05))
    assert cells.shades(cells.within(shapely.Polygon(square))) == {OCCUPIED}
    assert cells.shades(cells.within(shapely.box(0.2, 0.2, 1.9, 4.8))) == {FREE}


SQUARE = [[(0, 0), (5, 0)], [(5, 0), (5, 5)], [(5, 5), (0, 5)], [(0, 5), (0, 0)]]


@pytest.mark.parametrize("degrees", [0, 12, 45, 77])
@pytest.mark.parametrize("corner", [40, 60, 90, 135])
def test_the_corner_of_walls_that_end_at_each_other_is_solid(degrees: float, corner: float) -> None:
    turn = np.radians(degrees + np.array([0.0, corner]))
    away = np.column_stack([np.cos(turn), np.sin(turn)])
    material = shapely.LineString([4 * away[0], (0, 0), 4 * away[1]]).buffer(
        0.15, cap_style="flat", join_style="mitre", mitre_limit=5.0
    )
    inner = 0.15 / math.tan(math.radians(corner / 2))
    walls = [Wall.of(np.array([inner * d, 4 * d]), thickness=0.3) for d in away]
    for resolution in RESOLUTIONS:
        cells = Cells(occupancy_grid(walls, resolution=resolution))
        assert cells.shades(cells.within(material)) <= {OCCUPIED}
        assert OCCUPIED not in cells.shades(~cells.within(material.buffer(cells.reach)))


@pytest.mark.parametrize(("gap", "solid"), [(JOINT - 0.01, True), (JOINT + 0.03, False), (0.8, False)])
def test_only_gaps_that_nobody_passes_are_closed(gap: float, *, solid: bool) -> None:
    walls = [Wall.of(np.array([(x, 0.0), (x + 4, 0.0)]), thickness=0.3) for x in (0.0, 4.0 + gap)]
    middle = shapely.Point(4 + gap / 2, 0)
    assert bool(solid_of(walls).covers(middle)) == solid


def test_walls_that_end_side_by_side_leave_the_door_free() -> None:
    lining = [Wall.of(np.array([(0.0, y), (4.0, y)]), thickness=0.1) for y in (0.0, 0.1)]
    assert shapely.bounds(solid_of(lining))[2] == pytest.approx(4.0)


def test_a_shaft_wider_than_its_walls_stays_open() -> None:
    thick = [Wall.of(0.2 * np.array(line, dtype=float), thickness=0.3) for line in SQUARE]
    wide = [Wall.of(0.3 * np.array(line, dtype=float), thickness=0.3) for line in SQUARE]
    assert solid_of(thick).covers(shapely.Point(0.5, 0.5)) is False
    assert solid_of(wide).covers(shapely.Point(0.75, 0.75)) is False
    narrow = [Wall.of(0.11 * np.array(line, dtype=float), thickness=0.3) for line in SQUARE]
    assert solid_of(narrow).covers(shapely.Point(0.275, 0.275)) is True


def test_what_is_erased_is_free_body_and_all() -> None:
    around = [Wall.of(np.array(line, dtype=float), thickness=0.2) for line in SQUARE]
    middle = Wall.of(np.array([(2.5, 0.1), (2.5, 4.9)]), thickness=0.4)
    gone = Region(((2.0, 1.0), (3.0, 1.0), (3.0, 2.0), (2.0, 2.0)))
    cells = Cells(occupancy_grid([*around, middle], erased=[gone], resolution=0.05))
    assert cells.shades(cells.within(shapely.box(2.05, 1.05, 2.95, 1.95))) == {FREE}
    assert cells.shades(cells.within(shapely.box(2.3, 2.05, 2.7, 4.9))) == {OCCUPIED}


def test_the_real_plan_has_no_free_cell_in_its_walls(shared_cases: Path) -> None:
    reading = read_drawing_file(shared_cases / "46-grid-hollow-walls" / "base.dxf", options=DrawingOptions())
    walls = shapely.box(0, 0, 20, 12).difference(shapely.box(0.3, 0.3, 19.7, 11.7))
    partition = [shapely.box(9.9, 0.3, 10.0, 5.0), shapely.box(9.9, 5.9, 10.0, 11.7)]
    for resolution in RESOLUTIONS:
        cells = Cells(occupancy_grid(reading.walls, reading.columns, resolution=resolution))
        inside = cells.within(shapely.union_all([walls, *partition]))
        assert inside.sum() > 100
        assert cells.shades(inside) == {OCCUPIED}
        assert cells.shades(cells.within(shapely.box(9.8, 5.25, 10.1, 5.65))) == {FREE}
