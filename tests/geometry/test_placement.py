"""Placing scans of rooms with known truth: right from many starts, and never sure where nothing holds."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from service.domain.acceptance import judge
from service.domain.errors import FileEmpty, PlacementNotComputed
from service.domain.layer_part import REFERENCE, TARGET
from service.domain.transform import Transform
from tests.geometry.rooms import a_case, box, error_of, inside, off
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.target import PlacementTarget

STARTS = [(0.5, 0.0, 8.0), (-0.5, 0.3, -8.0), (0.0, -0.7, 5.0), (-0.4, -0.4, 10.0), (0.0, 0.0, 0.0)]


@pytest.mark.parametrize("start", STARTS)
def test_a_room_is_placed_right_from_every_start_with_the_object_left_in(
    start: tuple[float, float, float],
) -> None:
    case = a_case(1)
    placed = place_scan(case.scan, case.target, initial=off(case.truth, *start, dz=0.2))
    distance, angle = error_of(placed.T_map_scan, case.truth)
    assert distance < 0.01
    assert angle < 0.15
    assert judge(placed.evidence).verdict == "accepted", judge(placed.evidence).reasons


@pytest.mark.parametrize("start", STARTS[:3])
def test_a_room_is_placed_right_on_a_cloud(start: tuple[float, float, float]) -> None:
    case = a_case(2)
    target = PlacementTarget.from_cloud(inside(77))
    placed = place_scan(case.scan, target, initial=off(case.truth, *start))
    distance, angle = error_of(placed.T_map_scan, case.truth)
    assert distance < 0.03
    assert angle < 0.5


def test_the_box_is_target_and_the_walls_are_reference() -> None:
    case = a_case(3)
    placed = place_scan(case.scan, case.target, initial=off(case.truth, 0.3, 0.3, 5.0))
    on_box = np.arange(len(case.scan)) >= len(case.scan) - len(box(3))
    low = case.truth.apply(case.scan.points)[:, 2] < 0.15  # where the box meets the floor either is right
    assert np.mean(placed.labels[on_box & ~low] == TARGET) > 0.99
    assert np.mean(placed.labels[~on_box] == REFERENCE) > 0.99


@pytest.mark.parametrize("sides", [(0, 5), (0, 1), (3, 4)])
def test_a_bare_corner_is_never_accepted(sides: tuple[int, ...]) -> None:
    case = a_case(4, sides=sides)
    for start in STARTS:
        placed = place_scan(case.scan, case.target, initial=off(case.truth, *start))
        assert judge(placed.evidence).verdict != "accepted"


def test_one_wall_is_said_to_slide() -> None:
    case = a_case(5, sides=(0,), with_box=False)
    placed = place_scan(case.scan, case.target, initial=off(case.truth, 0.1, 0.1, 1.0))
    assert "x" in placed.evidence.weak_directions
    assert judge(placed.evidence).verdict != "accepted"


def test_without_floor_or_ceiling_in_the_scan_the_height_is_said_to_be_open() -> None:
    case = a_case(6, floor=False, with_box=False)
    placed = place_scan(case.scan, case.target, initial=off(case.truth, 0.1, 0.1, 1.0))
    assert "z" in placed.evidence.weak_directions
    assert judge(placed.evidence).verdict != "accepted"


@pytest.mark.parametrize("seed", range(4))
def test_a_scan_of_another_place_is_not_accepted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = a_case(7)
    room = np.array([4.1 + seed, 3.3]) * [1.0, 1.0]
    sides = [np.column_stack([rng.uniform(0, room[0], 3000), np.full(3000, y), rng.uniform(0, 2.4, 3000)])
             for y in (0.0, room[1])]  # fmt: skip
    sides += [np.column_stack([np.full(3000, x), rng.uniform(0, room[1], 3000), rng.uniform(0, 2.4, 3000)])
              for x in (0.0, room[0])]  # fmt: skip
    floor = np.column_stack([rng.uniform(0, 1, (3000, 2)) * room, np.zeros(3000)])
    other = np.vstack([*sides, floor]) - [room[0] / 2, room[1] / 2, 1.4]
    placed = place_scan(PointCloud.of(other), case.target, initial=Transform.from_xyz_yaw(2.4, 2.3, 1.4, 0.2))
    assert judge(placed.evidence).verdict != "accepted"


def test_a_rough_pose_far_from_everything_is_refused() -> None:
    case = a_case(8)
    nowhere = PlacementTarget.from_cloud(inside(1))
    with pytest.raises(PlacementNotComputed):
        place_scan(case.scan, nowhere, initial=Transform.from_xyz_yaw(500.0, 0.0, 0.0, 0.0))


def test_a_scan_of_a_handful_of_points_is_refused() -> None:
    case = a_case(8)
    few = PointCloud.of(case.scan.points[:50])
    with pytest.raises(PlacementNotComputed):
        place_scan(few, case.target, initial=case.truth)


def test_an_empty_map_is_refused() -> None:
    with pytest.raises(FileEmpty):
        PlacementTarget.from_cloud(np.zeros((0, 3)))
    with pytest.raises(FileEmpty):
        PlacementTarget.from_faces([], wall_height=2.5)


def test_what_progress_raises_ends_the_work() -> None:
    case = a_case(8)

    def stop(stage: str, share: float) -> None:
        if stage == "refine":
            raise KeyboardInterrupt(share)

    with pytest.raises(KeyboardInterrupt):
        place_scan(case.scan, case.target, initial=case.truth, progress=stop)


_SAME = """
import hashlib, sys
import numpy as np
from tests.geometry.rooms import a_case, off
from worker.geometry.registration.derivatives import derivatives
from worker.geometry.registration.ndt_map import build_ndt_map
from worker.geometry.registration.place import place_scan
case = a_case(9)
placed = place_scan(case.scan, case.target, initial=off(case.truth, 0.3, -0.2, 5.0))
many = np.random.default_rng(0).uniform(0, 6, (60_000, 3))
ndt_map = build_ndt_map(many[:30_000], 1.0)
score, g, H = derivatives(many, ndt_map, centre=many.mean(axis=0))
content = placed.T_map_scan.matrix.tobytes() + placed.labels.tobytes() + g.tobytes() + H.tobytes()
print(hashlib.sha256(content + repr((score, placed.evidence)).encode()).hexdigest())
"""


def test_the_answer_has_the_same_bytes_whatever_the_number_of_threads() -> None:
    root = Path(__file__).resolve().parents[2]
    digests = set()
    for threads in ("1", "2"):
        environment = {**os.environ, "NUMBA_NUM_THREADS": threads, "PYTHONPATH": str(root)}
        run = subprocess.run(
            [sys.executable, "-c", _SAME],
            cwd=root,
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        digests.add(run.stdout.strip())
    assert len(digests) == 1
    assert len(digests.pop()) == hashlib.sha256().digest_size * 2
