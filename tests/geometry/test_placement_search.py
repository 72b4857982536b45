"""Placing scans with no pose, or a very rough one; and places that cannot be told apart."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.acceptance import judge
from service.domain.errors import PlacementNotComputed
from service.domain.transform import Transform
from tests.geometry.rooms import CORNERS, HEIGHT, a_case, error_of, inside, walls
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.structure import find_floor, level_shift
from worker.geometry.registration.target import PlacementTarget


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_room_is_found_with_no_pose_among_others(seed: int) -> None:
    case = a_case(seed)
    square = np.array([(0.0, 0.0), (5.0, 0.0), (5.0, 4.0), (0.0, 4.0)])
    others = [*walls(square + np.array([20.0, 3.0])), *walls(square * 0.8 - np.array([9.0, 6.0]))]
    target = PlacementTarget.from_faces([*walls(), *others], wall_height=HEIGHT)
    placed = place_scan(case.scan, target, initial=None)
    distance, angle = error_of(placed.T_map_scan, case.truth)
    assert (distance < 0.01, angle < 0.15) == (True, True)
    assert judge(placed.evidence).verdict == "accepted", judge(placed.evidence).reasons
    assert (placed.evidence.moved_m, placed.evidence.turned_rad) == (0.0, 0.0)
    assert placed.evidence.poses_compared > 10_000


@pytest.mark.parametrize("away", [(2.6, 1.2, 40.0), (-1.5, 2.4, -42.0), (-2.0, -2.0, 10.0)])
def test_a_pose_may_be_3_m_and_45_degrees_off(away: tuple[float, float, float]) -> None:
    case = a_case(5)
    x, y, z = case.truth.translation + np.array([away[0], away[1], 0.9])
    initial = Transform.from_xyz_yaw(x, y, z, case.truth.rpy[2] + np.deg2rad(away[2]))
    placed = place_scan(case.scan, case.target, initial=initial)
    distance, angle = error_of(placed.T_map_scan, case.truth)
    assert (distance < 0.01, angle < 0.15) == (True, True)
    assert judge(placed.evidence).verdict == "accepted", judge(placed.evidence).reasons


def test_twin_rooms_are_two_candidates_and_a_question() -> None:
    case = a_case(6)
    twin = CORNERS + np.array([15.0, 0.0])
    target = PlacementTarget.from_faces([*walls(), *walls(twin)], wall_height=HEIGHT)
    placed = place_scan(case.scan, target, initial=None)
    judgement = judge(placed.evidence)
    assert judgement.verdict == "needs-review"
    assert any("fits almost as well" in reason.detail for reason in judgement.reasons)
    first, second = (c.T_map_scan.translation[0] for c in placed.candidates[:2])
    x = case.truth.translation[0]
    assert sorted((first, second)) == pytest.approx([x, x + 15.0], abs=0.01)


def test_a_room_is_found_on_a_bare_cloud_with_no_pose() -> None:
    case = a_case(7)
    placed = place_scan(case.scan, PlacementTarget.from_cloud(inside(78)), initial=None)
    distance, angle = error_of(placed.T_map_scan, case.truth)
    assert (distance < 0.03, angle < 0.5) == (True, True)


def test_a_scan_without_walls_is_no_placement() -> None:
    case = a_case(8)
    rng = np.random.default_rng(3)
    floor = np.column_stack([rng.uniform(-2, 2, (8000, 2)), np.full(8000, -1.4)])
    with pytest.raises(PlacementNotComputed, match="no upright surface"):
        place_scan(PointCloud.of(floor), case.target, initial=None)


def test_the_lowest_wide_level_below_the_tablet_is_the_floor() -> None:
    rng = np.random.default_rng(4)
    levels = {-1.4: 3000, -0.65: 900, 1.1: 3000}  # floor, a table, a ceiling that looks down
    points = np.vstack(
        [np.column_stack([rng.uniform(-2, 2, (n, 2)), np.full(n, z)]) for z, n in levels.items()]
    )
    points[:, 2] += rng.normal(0, 0.005, len(points))
    normals = np.zeros_like(points)
    normals[:, 2] = np.where(points[:, 2] > 0, -1.0, 1.0)
    floor = find_floor(points, normals, viewpoint=np.zeros(3))
    assert floor == pytest.approx(-1.4, abs=0.01)
    raised = points + np.array([0.0, 0.0, 0.75])
    shift = level_shift(points, normals, onto=raised, onto_normals=normals)
    assert shift == pytest.approx(0.75, abs=0.051)
