"""Regions taken off walls and points, clouds compared, and things that a later scan looked through."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.errors import NoWallsFound
from service.domain.recipe import Recipe
from service.domain.region import Region
from worker.formats.artifacts import write_artifacts
from worker.formats.pcd import read_pcd
from worker.formats.reading import load_walls_and_columns
from worker.geometry.cloud.difference import cloud_difference
from worker.geometry.cloud.erase import cut_columns, cut_walls, from_floor_to_top
from worker.geometry.cloud.free_space import Sight, things_of
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.cloud.within import within
from worker.geometry.drawing.reading.reading import Column, Wall

CORNERS = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0], [0.0, 0.0]])
ROOM = [Wall.of(CORNERS[k : k + 2], thickness=0.2) for k in range(4)]


def a_region(x0: float, y0: float, x1: float, y1: float, **heights: float) -> Region:
    return Region(((x0, y0), (x1, y0), (x1, y1), (x0, y1)), **heights)


def test_a_wall_is_cut_where_the_region_meets_it_and_its_faces_with_it() -> None:
    left, right = cut_walls(ROOM[:1], [a_region(4.0, -1.0, 6.0, 1.0)])
    assert np.allclose(left.centre, [[0.0, 0.0], [4.0, 0.0]])
    assert np.allclose(right.centre, [[6.0, 0.0], [10.0, 0.0]])
    assert np.allclose(left.faces[0][-1], [4.0, 0.1])
    assert np.allclose(right.faces[1][0], [6.0, -0.1])
    assert left.thickness == ROOM[0].thickness


def test_a_wall_with_a_corner_keeps_the_corner() -> None:
    wall = Wall.of(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0]]), thickness=0.2)
    (kept,) = cut_walls([wall], [a_region(-1.0, -1.0, 3.0, 1.0)])
    assert np.allclose(kept.centre, [[3.0, 0.0], [10.0, 0.0], [10.0, 8.0]])
    assert cut_walls([wall], [a_region(-1.0, -1.0, 11.0, 9.0)]) == ()
    assert cut_walls([wall], [a_region(20.0, 20.0, 21.0, 21.0)]) == (wall,)


def test_only_a_region_from_floor_to_top_takes_a_wall_away() -> None:
    low, whole = a_region(4.0, -1.0, 6.0, 1.0, z_max_m=1.0), a_region(4.0, -1.0, 6.0, 1.0, z_min_m=-0.1)
    assert from_floor_to_top([low, whole], 2.5) == [whole]
    inside, outside = (
        Column(np.array([[x, 0.0], [x + 0.4, 0.0], [x + 0.4, 0.4], [x, 0.4]])) for x in (4.5, 8.0)
    )
    assert cut_columns([inside, outside], [whole]) == (outside,)


def test_an_erased_region_holds_nothing_in_any_file(tmp_path: Path) -> None:
    region = a_region(4.0, -1.0, 6.0, 1.0)
    recipe = Recipe(voxel_size_m=0.1, floor=True)
    write_artifacts(tmp_path, walls=ROOM, recipe=recipe, inputs={}, erased=[region])
    cloud = read_pcd(tmp_path / "point-cloud.pcd")
    assert not within(region, cloud.points).any()
    outside = cloud.points[(cloud.points[:, 0] > 6.0) & (cloud.points[:, 1] < 1.0)]
    assert len(outside) > 1000, "what stands beside it stays"
    walls, _ = load_walls_and_columns(tmp_path / "walls.geojson")
    assert sum(w.length for w in walls) == pytest.approx(sum(w.length for w in ROOM) - 2.0)
    rows = (tmp_path / "occupancy-grid.pgm").read_bytes()
    header, cells = rows.split(b"255\n", 1)
    width, height = (int(n) for n in header.split()[1:3])
    grid = np.frombuffer(cells, dtype=np.uint8).reshape(height, width)[::-1]
    at = [round((v + 0.1 + 10 * 0.05) / 0.05) for v in (5.0, 0.0)]
    window = grid[at[1] - 3 : at[1] + 3, at[0] - 10 : at[0] + 10]
    assert not (window == 0).any(), "no wall is left on the grid"


def test_a_low_region_leaves_the_wall_above_it(tmp_path: Path) -> None:
    region = a_region(4.0, -1.0, 6.0, 1.0, z_max_m=1.0)
    write_artifacts(tmp_path, walls=ROOM, recipe=Recipe(voxel_size_m=0.1), inputs={}, erased=[region])
    points = read_pcd(tmp_path / "point-cloud.pcd").points
    above = within(a_region(4.0, -1.0, 6.0, 1.0, z_min_m=1.0), points)
    assert not within(region, points).any()
    assert above.sum() > 100


def test_a_map_of_which_everything_is_erased_is_refused(tmp_path: Path) -> None:
    everything = a_region(-1.0, -1.0, 11.0, 9.0)
    with pytest.raises(NoWallsFound, match="Everything is erased"):
        write_artifacts(tmp_path, walls=ROOM, recipe=Recipe(), inputs={}, erased=[everything])


def test_clouds_differ_by_points_and_labels_and_how_often_they_are_there() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    before = PointCloud.of(points, Label.WALL)
    labels = np.array([Label.WALL, Label.WALL, Label.LAYER], dtype=np.uint32)
    after = PointCloud(np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), labels)
    found = cloud_difference(before, after)
    assert found.kept == 2
    assert found.added.points.tolist() == [[0.0, 0.0, 0.0]]
    assert found.added.labels.tolist() == [Label.LAYER]
    assert found.removed.points.tolist() == [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    same = cloud_difference(before, before)
    assert (len(same.added), len(same.removed), same.kept) == (0, 0, 4)


def a_box(x: float, y: float, size: float = 1.0) -> NDArray[np.float64]:
    """Return points on the upright faces of a box on the floor, 3 cm apart."""
    along, up = np.arange(0.0, size, 0.03), np.arange(0.0, 1.2, 0.03)
    a, z = (v.ravel() for v in np.meshgrid(along, up))
    low, high = np.zeros_like(a), np.full_like(a, size)
    sides = [(a, low), (a, high), (low, a), (high, a)]
    return np.vstack([np.column_stack([x + u, y + v, z]) for u, v in sides])


def seen_room(eye: NDArray[np.float64], *things: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what is seen of a room from a place: along each ray of half a degree what comes first."""
    along, up = np.arange(0.0, 8.0, 0.03), np.arange(0.0, 2.5, 0.03)
    a, z = (v.ravel() for v in np.meshgrid(along, up))
    zero, eight = np.zeros_like(a), np.full_like(a, 8.0)
    walls = [np.column_stack([*xy, z]) for xy in ((a, zero), (a, eight), (zero, a), (eight, a))]
    points = np.vstack([*walls, *things])
    rays = points - eye
    distance = np.linalg.norm(rays, axis=1)
    bins = np.round(np.column_stack([np.arctan2(rays[:, 1], rays[:, 0]), rays[:, 2] / distance]) / 0.0087)
    order = np.lexsort((distance, bins[:, 1], bins[:, 0]))
    first = np.concatenate([[True], np.any(np.diff(bins[order], axis=0) != 0, axis=1)])
    return np.asarray(points[order[first]])


def test_what_a_scan_looked_through_has_gone_and_what_it_sees_or_cannot_see_has_not() -> None:
    eye = np.array([4.0, 4.0, 1.5])
    gone, there, behind = a_box(1.5, 5.0), a_box(5.5, 1.5), a_box(6.9, 0.3, 0.5)
    sight = Sight(seen_room(eye, there), eye)
    told = {name: sight.of(thing) for name, thing in (("gone", gone), ("there", there), ("behind", behind))}
    assert told["gone"].is_gone, told
    assert not told["there"].is_gone, told
    assert not told["behind"].is_gone, told


def test_the_things_of_a_layer_are_told_apart_and_each_has_its_region() -> None:
    boxes = a_box(1.0, 1.0), a_box(5.0, 5.0)
    floor = np.column_stack([np.random.default_rng(1).uniform(0, 8, (5000, 2)), np.full(5000, 0.02)])
    things = list(things_of(np.vstack([*boxes, floor]), top=2.5))
    assert len(things) == 2
    for thing, box in zip(things, boxes, strict=True):
        assert within(thing.region, box).all()
        assert thing.region.z_min_m is None
        others = boxes[1] if box is boxes[0] else boxes[0]
        assert not within(thing.region, others).any()
