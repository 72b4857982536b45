"""The generated hall: its drawing and its scene tell the same story, its scan is of the new machine."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from demo.hall import METRES_PER_PX, NEW_MACHINE
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, rough_pose, scan_of_new_machine
from tests.factories import synthetic_hall
from worker.geometry.lidar.ray_casting import MISS, cast_rays

SEEDS = (1, 2, 3, 17)


@pytest.mark.parametrize("seed", SEEDS)
def test_beams_that_meet_a_wall_of_the_scene_end_on_ink_of_the_drawing(seed: int) -> None:
    hall = synthetic_hall(seed)
    sheet = np.asarray(Image.open(io.BytesIO(drawing_png(hall))))
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False) + 1e-3
    unit = np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    solids = hall.scene.only("wall", "column")
    for room in hall.rooms:
        origins = np.tile((*room.floor.centre, 1.0), (len(unit), 1))
        hits = cast_rays(solids, origins, unit)
        hit = hits.object_ids != MISS
        assert hit.mean() > 0.8
        inside = hits.points[hit] + unit[hit] * METRES_PER_PX / 2
        columns = np.floor(inside[:, 0] / METRES_PER_PX).astype(int)
        rows = np.floor((hall.sheet_size[1] - inside[:, 1]) / METRES_PER_PX).astype(int)
        assert (sheet[rows, columns] == 0).mean() > 0.99


@pytest.mark.parametrize("seed", SEEDS)
def test_the_known_length_gives_the_scale_at_which_the_sheet_was_drawn(seed: int) -> None:
    hall = synthetic_hall(seed)
    clicked = known_length(hall)
    pixels = math.hypot(clicked.x2 - clicked.x1, clicked.y2 - clicked.y1)
    assert clicked.length_m / pixels == pytest.approx(METRES_PER_PX)
    height, width = np.asarray(Image.open(io.BytesIO(drawing_png(hall)))).shape
    assert (width, height) == pytest.approx(np.array(hall.sheet_size) / METRES_PER_PX, abs=0.01)


@pytest.mark.parametrize("seed", range(40))
def test_every_hall_has_room_for_its_doors_and_machines(seed: int) -> None:
    hall = synthetic_hall(seed)
    assert all(min(wall.size) > 0.1 for wall in hall.walls)
    for machine in hall.machines:
        corners = machine.scene().vertices
        assert not any(solid.contains(corners).any() for solid in (*hall.walls, *hall.columns))
    base = hall.new_machine.scene().vertices
    assert hall.shop.floor.contains(base, margin=-1.0).all()


def test_the_same_seed_draws_the_same_sheet_and_another_seed_another() -> None:
    first, again, other = (drawing_png(synthetic_hall(seed)) for seed in (5, 5, 6))
    assert first == again
    assert first != other


def test_the_scan_holds_the_machine_and_walls_on_three_sides() -> None:
    hall = synthetic_hall(1)
    scan = scan_of_new_machine(hall, seed=1)
    on_machine = scan.object_ids == hall.scene.id_of(NEW_MACHINE)
    in_map = scan.T_map_scan.apply(scan.cloud.points)
    assert hall.new_machine.holds(in_map, margin=0.05).sum() > 0.9 * on_machine.sum() > 10_000
    walls = in_map[scan.object_ids == hall.scene.id_of("wall")]
    shop = hall.shop.floor
    sides = [
        np.abs(walls[:, axis] - at) < 0.05
        for axis, at in ((0, shop.x0), (0, shop.x1), (1, shop.y0), (1, shop.y1))
    ]
    assert sum(side.sum() > 5_000 for side in sides) >= 3


def test_the_rough_pose_is_as_far_off_as_it_says() -> None:
    truth = scan_of_new_machine(synthetic_hall(2), seed=2).T_map_scan
    off, turned = rough_pose(truth, seed=9, off=0.5, turn_deg=8.0).distance_to(truth)
    assert off == pytest.approx(0.5)
    assert math.degrees(turned) == pytest.approx(8.0)


def test_a_ply_file_ends_with_its_points_in_single_precision() -> None:
    points = np.array([(1.5, -2.25, 0.125), (4.0, 5.0, 6.0)])
    header, body = ply_bytes(points).split(b"end_header\n", 1)
    assert b"element vertex 2\n" in header
    assert np.array_equal(np.frombuffer(body, "<f4").reshape(2, 3), points)
