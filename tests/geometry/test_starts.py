"""Which ends of several starts are one pose, and where the starts lie."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.transform import Transform
from tests.geometry.rooms import inside
from worker.geometry.registration.ndt import LEVELLED, register_ndt
from worker.geometry.registration.ndt_map import build_ndt_map
from worker.geometry.registration.starts import End, ends_of, merge_ends, start_poses

MIDDLE = np.array([4.0, 0.0, 1.0])


def end(x: float, yaw_deg: float = 0.0, *, score: float = 1.0) -> End:
    """Return an end that puts the scan's middle at `x`, turned about it."""
    turn = Transform.from_xyz_yaw(0.0, 0.0, 0.0, np.deg2rad(yaw_deg))
    back = Transform.from_xyz_yaw(*(-MIDDLE).tolist(), 0.0)
    return End(
        Transform.from_xyz_yaw(x, 0.0, 1.0, 0.0) @ turn @ back, score, 1, converged=True, iterations=10
    )


@pytest.mark.parametrize(
    ("other", "poses"), [((0.095, 0.0), 1), ((0.105, 0.0), 2), ((0.0, 0.95), 1), ((0.0, 1.05), 2)]
)
def test_ends_nearer_than_10_cm_and_a_degree_are_one(other: tuple[float, float], poses: int) -> None:
    merged = merge_ends([end(0.0, score=1.0), end(*other, score=2.0)], MIDDLE)
    assert len(merged) == poses
    assert merged[0].score == 2.0
    assert (merged[0].starts, merged[0].iterations) == ((2, 20) if poses == 1 else (1, 10))


def test_starts_lie_half_a_metre_aside_and_eight_degrees_turned() -> None:
    rough = Transform.from_xyz_yaw(3.0, 2.0, 0.0, 0.3)
    centre = np.array([5.0, 5.0, 0.0])
    starts = start_poses(rough, centre)
    here = rough.apply(rough.inverse().apply(centre[None]))[0]
    found = {
        tuple(
            np.round([*(s.apply(rough.inverse().apply(centre[None]))[0] - here)[:2], np.rad2deg(turn)], 6)
            + 0.0
        )
        for s in starts
        for turn in [np.arctan2(s.rotation[1, 0], s.rotation[0, 0]) - 0.3]
    }
    assert found == {(0, 0, 0), (0.5, 0, 0), (-0.5, 0, 0), (0, 0.5, 0), (0, -0.5, 0), (0, 0, 8), (0, 0, -8)}


def test_every_start_ends_at_one_of_the_poses_with_the_work_done_for_it() -> None:
    room = inside(3)[::40]
    coarse, fine = build_ndt_map(inside(3), 2.0), build_ndt_map(inside(3), 1.0)
    starts = start_poses(Transform.from_xyz_yaw(0.1, -0.1, 0.0, 0.02), room.mean(axis=0))
    told: list[float] = []
    ends = ends_of(room, [coarse, fine], starts=starts, told=told.append)
    assert sum(found.starts for found in ends) == len(starts) == len(told)
    assert (ends[0].starts, ends[0].converged) == (7, True)
    assert ends[0].T_map_scan.distance_to(Transform.identity())[0] < 0.02
    work = 0
    for start in starts:
        how = {"unknowns": LEVELLED}
        first = register_ndt(room, coarse, initial=start, tolerance=1e-2, max_iterations=30, **how)
        last = register_ndt(
            room, fine, initial=first.T_target_source, tolerance=1e-3, max_iterations=60, **how
        )
        work += first.iterations + last.iterations
    assert ends[0].iterations == work
