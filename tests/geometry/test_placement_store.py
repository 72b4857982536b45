"""Placing scans of a full store: tall shelves hide most walls, and the hall is its own half turn."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from service.domain.acceptance import judge
from service.domain.layer_part import TARGET
from service.domain.transform import Transform
from tests.geometry.rooms import HEIGHT, a_case, error_of, inside, off, walls
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.lidar.scene import Scene, turned_box
from worker.geometry.lidar.tablet import TabletPath, TabletScan, TabletSensor, scan_with_tablet
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.target import PlacementTarget

LONG, WIDE, TALL = 16.0, 11.0, 4.0
CORNERS = np.array([[0, 0], [LONG, 0], [LONG, WIDE], [0, WIDE]], dtype=np.float64)


@cache
def store() -> Scene:
    """Return the floor, four walls of 4 m, and a shelf of 3 m along one wall, four across, and pallets."""
    sides = [
        ((8, -0.1), (16.4, 0.2)),
        ((8, 11.1), (16.4, 0.2)),
        ((-0.1, 5.5), (0.2, 11)),
        ((16.1, 5.5), (0.2, 11)),
    ]
    hall = [turned_box((8, 5.5, -0.2), (17, 12, 0.2), yaw=0, name="floor")]
    hall += [turned_box((*at, 0), (*size, TALL), yaw=0, name="wall") for at, size in sides]
    goods = [turned_box((6, 0.7, 0), (10, 0.9, 3.0), yaw=0, name="shelf")]
    goods += [turned_box((x, 8.5, 0), (0.9, 3.6, 2.6), yaw=0, name="shelf") for x in (4.0, 7.0, 10.0, 13.0)]
    goods += [turned_box((x, 4.6, 0), (1.2, 0.8, 1.1), yaw=x, name="pallet") for x in (3.0, 6.5, 11.0)]
    return Scene.of(*hall, *goods)


@cache
def scan() -> TabletScan:
    """Return a scan taken from seven places."""
    stops = [(1.5, 3.0), (4.8, 3.0), (8.6, 2.6), (12.5, 3.2), (14.6, 6.0), (8.5, 6.0), (2.0, 7.5)]
    path = TabletPath.turning(stops[0], start_yaw=0.4, frames=36)
    for stop in stops[1:]:
        path = path.then(TabletPath.turning(stop, start_yaw=0.4, frames=36))
    return scan_with_tablet(store(), path, seed=5, sensor=TabletSensor(detail=0.04))


def hall() -> PlacementTarget:
    """Return the map: four walls, as high as a drawing's are unless it says otherwise."""
    return PlacementTarget.from_faces(walls(CORNERS), wall_height=HEIGHT)


@pytest.mark.parametrize(("dx", "dy", "turn"), [(2.0, -1.5, 30.0), (-1.0, 2.0, -40.0)])
def test_a_full_store_is_placed_from_a_rough_pose_and_its_goods_are_the_target(
    dx: float, dy: float, turn: float
) -> None:
    taken = scan()
    placed = place_scan(
        PointCloud.of(taken.cloud.points), hall(), initial=off(taken.T_map_scan, dx, dy, turn)
    )
    distance, angle = error_of(placed.T_map_scan, taken.T_map_scan)
    assert distance < 0.02
    assert angle < 0.1
    assert judge(placed.evidence).verdict == "accepted", judge(placed.evidence).reasons
    goods = np.isin(
        taken.object_ids, [i for i, name in enumerate(store().names) if name in {"shelf", "pallet"}]
    )
    found = placed.labels == TARGET
    assert 2 * np.sum(goods & found) / (np.sum(goods) + np.sum(found)) > 0.95


def test_without_a_pose_the_two_halves_of_a_turn_are_the_candidates() -> None:
    taken = scan()
    placed = place_scan(PointCloud.of(taken.cloud.points), hall(), initial=None)
    assert judge(placed.evidence).verdict == "needs-review"
    half_turn = Transform.from_xyz_yaw(LONG, WIDE, 0.0, np.pi) @ taken.T_map_scan
    first_two = [c.T_map_scan for c in placed.candidates[:2]]
    for truth in (taken.T_map_scan, half_turn):
        assert min(error_of(pose, truth)[0] for pose in first_two) < 0.02


def test_walls_go_on_above_the_height_that_the_map_has_them() -> None:
    case = a_case(21, with_box=False)
    target = PlacementTarget.from_faces(walls(), wall_height=1.3)
    placed = place_scan(case.scan, target, initial=off(case.truth, 0.3, 0.3, 5.0))
    assert placed.evidence.inlier_share_of_structure > 0.95
    assert len(case.scan) == len(inside(21))
    assert np.mean(placed.labels == TARGET) < 0.01
