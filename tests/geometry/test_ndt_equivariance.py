"""Moving the world moves the answer with it."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from service.domain.transform import Transform
from tests.geometry.rooms import inside
from worker.geometry.registration.ndt import LEVELLED, register_ndt
from worker.geometry.registration.ndt_map import build_ndt_map

TARGET = inside(10)
SOURCE = inside(11)[::12]
START = Transform.from_xyz_rpy((0.2, -0.15, 0.1), np.deg2rad((1.0, -1.0, 4.0)))
ANSWER = register_ndt(SOURCE, build_ndt_map(TARGET, 1.0), initial=START, tolerance=1e-6)

whole_metres = st.integers(-500, 500)


def test_the_room_on_itself_ends_at_identity() -> None:
    distance, angle = ANSWER.T_target_source.distance_to(Transform.identity())
    assert ANSWER.converged
    assert distance < 0.02
    assert angle < np.deg2rad(0.3)
    assert (np.linalg.eigvalsh(ANSWER.hessian) < 0).all()


@settings(max_examples=8, deadline=None)
@given(x=whole_metres, y=whole_metres, z=whole_metres, quarter=st.integers(0, 3))
def test_whole_cells_and_quarter_turns_move_the_answer_exactly(x: int, y: int, z: int, quarter: int) -> None:
    T = Transform.from_xyz_yaw(x, y, z, quarter * np.pi / 2)
    result = register_ndt(SOURCE, build_ndt_map(T.apply(TARGET), 1.0), initial=T @ START, tolerance=1e-6)
    distance, angle = result.T_target_source.distance_to(T @ ANSWER.T_target_source)
    assert distance < 2e-3  # points on a cell's border may change sides by rounding
    assert angle < 1e-3


@settings(max_examples=8, deadline=None)
@given(move=st.tuples(*[st.floats(-20, 20)] * 3), yaw=st.floats(-3, 3))
def test_any_motion_moves_the_answer_within_the_lattice_s_influence(
    move: tuple[float, float, float], yaw: float
) -> None:
    T = Transform.from_xyz_yaw(*move, yaw)
    result = register_ndt(SOURCE, build_ndt_map(T.apply(TARGET), 1.0), initial=T @ START, tolerance=1e-6)
    distance, angle = result.T_target_source.distance_to(T)
    assert distance < 0.05
    assert angle < np.deg2rad(0.8)


@settings(max_examples=8, deadline=None)
@given(move=st.tuples(*[st.floats(-5, 5)] * 3), rpy=st.tuples(*[st.floats(-1, 1)] * 3))
def test_the_source_s_own_frame_does_not_matter(
    move: tuple[float, float, float], rpy: tuple[float, float, float]
) -> None:
    T = Transform.from_xyz_rpy(move, rpy)
    ndt_map = build_ndt_map(TARGET, 1.0)
    result = register_ndt(T.apply(SOURCE), ndt_map, initial=START @ T.inverse(), tolerance=1e-6)
    distance, angle = (result.T_target_source @ T).distance_to(ANSWER.T_target_source)
    assert distance < 1e-5
    assert angle < 1e-5


def test_a_levelled_search_leaves_the_tilt_alone() -> None:
    result = register_ndt(SOURCE, build_ndt_map(TARGET, 1.0), initial=START, unknowns=LEVELLED)
    np.testing.assert_allclose(result.T_target_source.rotation[2], START.rotation[2], atol=1e-12)
