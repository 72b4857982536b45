"""Walls to a map: the conditions that every voxel size of the paper has to keep."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from service.domain.bounds import Bounds
from service.domain.errors import TooManyPoints
from service.domain.recipe import MapFromDrawing, Recipe
from worker.geometry.cloud.extrude import levels
from worker.geometry.cloud.merge import PlacedLayer, compound, map_transform, place_walls
from worker.geometry.cloud.occupancy_grid import FREE, OCCUPIED, UNKNOWN, occupancy_grid
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.drawing.reading.reading import Wall

PAPER_SIZES = (0.025, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)


def a_room(thickness: float = 0.2) -> list[Wall]:
    """Return a 6 x 4 m room with a 0.9 m door, turned by 20 degrees."""
    corners = [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)]
    lines = [*pairwise(corners), (corners[3], (0.0, 2.0)), ((0.0, 1.1), corners[0])]
    c, s = math.cos(math.radians(20)), math.sin(math.radians(20))
    turn = np.array([[c, -s], [s, c]])
    return [Wall.of(np.array(line) @ turn.T, thickness=thickness) for line in lines]


@pytest.mark.parametrize("added", ["nothing", "planes"])
@pytest.mark.parametrize("size", PAPER_SIZES)
def test_every_condition_of_the_map_holds(size: float, added: str) -> None:
    walls = a_room()
    cloud = compound(
        walls, recipe=Recipe(voxel_size_m=size, floor=added == "planes", ceiling=added == "planes")
    )
    written = cloud.points.astype(np.float32)
    assert np.array_equal(written.astype(np.float64), cloud.points)
    for voxel in (np.floor(cloud.points / size), np.floor(written / np.float32(size))):
        assert len(np.unique(voxel, axis=0)) == len(cloud)
    wall = cloud.points[cloud.labels == Label.WALL]
    assert (wall[:, 2].min(), wall[:, 2].max()) == (0.0, np.float32(2.5))
    assert (cloud.points[:, 2].min(), cloud.points[:, 2].max()) == (0.0, np.float32(2.5))
    faces = shapely.STRtree([shapely.LineString(f) for w in walls for f in w.faces])
    _, far = faces.query_nearest(shapely.points(wall[:, :2]), return_distance=True, all_matches=False)
    assert far.max() <= 0.01 + 1e-5 < math.sqrt(3) * size


@pytest.mark.parametrize("size", PAPER_SIZES)
def test_faces_are_covered_without_holes(size: float) -> None:
    walls = a_room()
    cloud = compound(walls, recipe=Recipe(voxel_size_m=size))
    foot = cloud.points[cloud.points[:, 2] == 0.0, :2]
    for wall in walls:
        for face in wall.faces:
            sample = face[0] + (face[1] - face[0]) * np.linspace(0, 1, 50)[:, None]
            gap = np.linalg.norm(sample[:, None] - foot[None], axis=2).min(axis=1)
            assert gap.max() <= math.sqrt(2) * size + 0.011


@pytest.mark.parametrize("height", [0.3, 1.0, 2.4, 2.5, 3.0, 7.77])
@pytest.mark.parametrize("size", PAPER_SIZES)
def test_levels_are_even_and_never_share_a_voxel(height: float, size: float) -> None:
    z = levels(height, size)
    assert (z[0], z[-1]) == (0.0, height)
    assert np.ptp(np.diff(z)) < 1e-9
    if height > 1.001 * size:
        written = z.astype(np.float32)
        for voxel in (np.floor(written.astype(np.float64) / size), np.floor(written / np.float32(size))):
            assert len(np.unique(voxel)) == len(z)


def test_walls_lower_than_a_voxel_still_have_foot_and_top() -> None:
    cloud = compound(a_room(), recipe=Recipe(voxel_size_m=0.5, wall_height_m=0.3, floor=True, ceiling=True))
    assert len(np.unique(np.floor(cloud.points / 0.5), axis=0)) == len(cloud)
    assert cloud.points[:, 2].min() == 0.0
    assert cloud.points[:, 2].max() == np.float32(0.3)


def test_no_wall_is_perfectly_flat_and_the_jitter_repeats() -> None:
    wall = [Wall.of(np.array([[0.05, 0.05], [9.95, 0.05]]), thickness=0.0)]
    cloud = compound(wall, recipe=Recipe(voxel_size_m=0.1))
    off = cloud.points[:, 1] - 0.05
    assert np.abs(off).max() <= 0.01 + 1e-6
    assert 0.002 < off.std() < 0.01
    again = compound(wall, recipe=Recipe(voxel_size_m=0.1))
    assert np.array_equal(again.points, cloud.points)


def test_floor_and_ceiling_cover_the_room_and_nothing_else() -> None:
    walls = a_room()
    cloud = compound(walls, recipe=Recipe(voxel_size_m=0.1, floor=True, ceiling=True))
    outline = shapely.MultiPoint(np.vstack([w.centre for w in walls])).convex_hull
    for label in (Label.FLOOR, Label.CEILING):
        plane = cloud.points[cloud.labels == label]
        assert outline.buffer(0.3).covers(shapely.MultiPoint(plane[:, :2]))
        assert len(plane) * 0.01 == pytest.approx(6 * 4, rel=0.1)


def test_the_map_follows_T_map_drawing() -> None:
    recipe = Recipe(voxel_size_m=0.1, map_from_drawing=MapFromDrawing(3.0, -2.0, math.radians(90)))
    moved = place_walls(a_room(), map_transform(recipe))
    for before, after in zip(a_room(), moved, strict=True):
        expected = before.faces[0] @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + [3.0, -2.0]
        assert np.allclose(after.faces[0], expected)


def test_layers_stay_dense_and_come_last() -> None:
    scan = PointCloud.of(np.random.default_rng(0).uniform(1, 2, (20_000, 3)))
    recipe = Recipe(voxel_size_m=0.4, layer_voxel_size_m=0.05)
    bare = compound(a_room(), recipe=recipe)
    cloud = compound(a_room(), recipe=recipe, layers=[PlacedLayer("press", scan)])
    assert np.array_equal(cloud.points[: len(bare)], bare.points)
    layer = cloud.points[cloud.labels == Label.LAYER]
    assert len(layer) == len(np.unique(np.floor(scan.points / 0.05), axis=0))


def test_a_map_of_too_many_points_is_refused_before_it_is_made() -> None:
    with pytest.raises(TooManyPoints) as refusal:
        compound(a_room(), recipe=Recipe(voxel_size_m=0.025), bounds=Bounds(max_map_points=10_000))
    assert refusal.value.members["max_points"] == 10_000


def test_the_occupancy_grid_knows_walls_floor_and_outside() -> None:
    grid = occupancy_grid(
        [Wall.of(np.array(line, dtype=float), thickness=0.2) for line in SQUARE], resolution=0.05
    )

    def at(x: float, y: float) -> int:
        column = int((x - grid.origin[0]) / 0.05)
        row = grid.cells.shape[0] - 1 - int((y - grid.origin[1]) / 0.05)
        return int(grid.cells[row, column])

    assert at(0.0, 2.5) == at(0.05, 2.5) == at(-0.05, 2.5) == OCCUPIED
    assert at(2.5, 2.5) == FREE
    assert at(-0.4, 2.5) == UNKNOWN


SQUARE = [
    [(0, 0), (5, 0)],
    [(5, 0), (5, 5)],
    [(5, 5), (0, 5)],
    [(0, 5), (0, 0)],
]
