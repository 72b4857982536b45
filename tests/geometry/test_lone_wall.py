"""A hall of which a scan shows one end: the end wall alone holds it there, and a door tells on it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.acceptance import judge
from service.domain.transform import Transform
from tests.geometry.rooms import a_case
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall
from worker.geometry.registration.place import Placed, place_scan
from worker.geometry.registration.target import PlacementTarget

LONG, WIDE, HIGH, THICK = 14.0, 4.0, 2.6, 0.2
SEEN = 6.0
DOOR = (2.4, 3.4)
DENSITY = 400


def drawn(*, end: float) -> tuple[Wall, ...]:
    """Return the walls of the hall with its end drawn at x = `end`, a door in the upper one."""
    lines = [
        ((end, -THICK / 2), (LONG, -THICK / 2)),
        ((end, WIDE + THICK / 2), (DOOR[0], WIDE + THICK / 2)),
        ((DOOR[1], WIDE + THICK / 2), (LONG, WIDE + THICK / 2)),
        ((end - THICK / 2, -THICK), (end - THICK / 2, WIDE + THICK)),
        ((LONG + THICK / 2, -THICK), (LONG + THICK / 2, WIDE + THICK)),
    ]
    return tuple(Wall.of(np.array(line), thickness=THICK) for line in lines)


def scanned(seed: int) -> NDArray[np.float64]:
    """Return what is seen of the hall from its end at x = 0, in frame `map`, with 5 mm of noise."""
    rng = np.random.default_rng(seed)

    def upright(a: tuple[float, float], b: tuple[float, float]) -> NDArray[np.float64]:
        n = int(DENSITY * np.hypot(b[0] - a[0], b[1] - a[1]) * HIGH)
        along = np.array(a) + rng.uniform(0, 1, (n, 1)) * (np.array(b) - a)
        return np.column_stack([along, rng.uniform(0, HIGH, n)])

    parts = [
        upright((0, 0), (SEEN, 0)),
        upright((0, WIDE), (DOOR[0], WIDE)),
        upright((DOOR[1], WIDE), (SEEN, WIDE)),
        upright((0, 0), (0, WIDE)),
        np.column_stack([rng.uniform(0, SEEN, 6000), rng.uniform(0, WIDE, 6000), np.zeros(6000)]),
    ]
    points = np.vstack(parts)
    return points + rng.normal(0, 0.005, points.shape)


def placed(*, end: float) -> Placed:
    eye = Transform.from_xyz_yaw(2.5, 1.8, 1.4, 0.4)
    scan = PointCloud.of(eye.inverse().apply(scanned(1)))
    target = PlacementTarget.from_faces(drawn(end=end), wall_height=HIGH)
    return place_scan(scan, target, initial=Transform.from_xyz_yaw(2.3, 1.9, 1.4, 0.5))


def test_a_wall_where_it_is_drawn_is_believed_and_said_to_be_alone() -> None:
    found = placed(end=0.0)
    assert found.evidence.closed_directions == 1
    assert found.evidence.slide_gain is not None
    assert found.evidence.slide_gain < 0.0
    judgement = judge(found.evidence)
    assert judgement.verdict == "accepted", judgement.reasons
    assert "so does the scan" in judgement.reasons[-1].detail


@pytest.mark.parametrize("end", [-0.8, -0.4, 0.35])
def test_a_wall_drawn_elsewhere_is_told_by_a_door(end: float) -> None:
    found = placed(end=end)
    assert judge(found.evidence).verdict != "accepted"
    if abs(found.T_map_scan.translation[0] - 2.5 - end) < 0.05:  # it went with the wall
        assert found.evidence.slide_gain is not None
        assert found.evidence.slide_gain > 0.02
        assert found.evidence.slide_m == pytest.approx(-end, abs=0.06)


def test_where_walls_face_each_other_none_is_alone() -> None:
    case = a_case(1)
    found = place_scan(case.scan, case.target, initial=case.truth)
    assert (found.evidence.closed_directions, found.evidence.slide_gain) == (2, None)
