"""Scans with a flipped axis: what only looks like the place."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.acceptance import judge
from service.domain.transform import Transform
from tests.geometry.rooms import HEIGHT, a_case, off, walls
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.target import PlacementTarget

OBLONG = np.array([(20.0, 0.0), (25.0, 0.0), (25.0, 4.0), (20.0, 4.0)])
EYE = Transform.from_xyz_yaw(22.0, 1.5, 1.4, 0.7)


def oblong(seed: int) -> PointCloud:
    """Return a scan of the oblong room, which is its own mirror image, from (22, 1.5)."""
    rng = np.random.default_rng(seed)
    along, up = rng.uniform(0.0, 18.0, 9000), rng.uniform(0.0, HEIGHT - 0.1, 9000)
    corner = np.cumsum([0.0, 5.0, 4.0, 5.0])
    side = np.searchsorted(corner, along, side="right") - 1
    to = np.roll(OBLONG, -1, axis=0)[side]
    share = (along - corner[side]) / np.linalg.norm(to - OBLONG[side], axis=1)
    feet = OBLONG[side] + share[:, None] * (to - OBLONG[side])
    ground = np.column_stack([rng.uniform((20.0, 0.0), (25.0, 4.0), (4000, 2)), np.zeros(4000)])
    points = np.vstack([np.column_stack([feet, up]), ground])
    return PointCloud.of(EYE.inverse().apply(points + rng.normal(0.0, 0.005, points.shape)))


def test_a_room_that_is_its_own_mirror_image_is_looked_at_by_a_person() -> None:
    target = PlacementTarget.from_faces([*walls(), *walls(OBLONG)], wall_height=HEIGHT)
    placed = place_scan(oblong(1), target, initial=off(EYE, 0.2, 0.1, 5.0))
    assert placed.T_map_scan.distance_to(EYE)[0] < 0.01
    assert placed.evidence.mirrored_inlier_share == pytest.approx(1.0, abs=0.01)
    judgement = judge(placed.evidence)
    assert judgement.verdict == "needs-review"
    assert any("its own mirror image" in reason.detail for reason in judgement.reasons)


def test_a_map_that_is_its_own_mirror_image_is_not_asked() -> None:
    target = PlacementTarget.from_faces(walls(OBLONG), wall_height=HEIGHT)
    placed = place_scan(oblong(2), target, initial=off(EYE, 0.2, 0.1, 5.0))
    assert placed.evidence.mirrored_inlier_share is None
    assert not any("flipped axis" in reason.detail for reason in judge(placed.evidence).reasons)


@pytest.mark.parametrize("seed", [3, 4])
def test_a_scan_with_a_flipped_axis_is_never_accepted(seed: int) -> None:
    case = a_case(seed)
    flipped = PointCloud.of(case.scan.points * (1.0, -1.0, 1.0))
    for initial in (None, off(case.truth, 0.2, -0.1, 5.0)):
        assert judge(place_scan(flipped, case.target, initial=initial).evidence).verdict != "accepted"
    right = place_scan(case.scan, case.target, initial=case.truth).evidence
    assert judge(right).verdict == "accepted"
