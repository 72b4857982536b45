"""Rigid transforms: closed forms, invariants, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.domain.transform import Transform

ANGLES = st.floats(-math.pi, math.pi)
METRES = st.floats(-1e3, 1e3)
POSES = st.builds(
    lambda x, y, z, r, p, w: Transform.from_xyz_rpy((x, y, z), (r, p, w)),
    METRES, METRES, METRES, ANGLES, st.floats(-1.5, 1.5), ANGLES,
)  # fmt: skip


def test_a_quarter_turn_takes_x_to_y_and_then_moves() -> None:
    T_map_scan = Transform.from_xyz_yaw(1.0, 2.0, 3.0, math.pi / 2)
    np.testing.assert_allclose(T_map_scan.apply(np.array([[1.0, 0.0, 0.0]])), [[1.0, 3.0, 3.0]], atol=1e-12)


@given(POSES)
def test_the_inverse_undoes_the_motion(T: Transform) -> None:
    np.testing.assert_allclose((T @ T.inverse()).matrix, np.eye(4), atol=1e-9)


@given(POSES, POSES)
def test_a_product_is_one_motion_after_the_other(T_a_b: Transform, T_b_c: Transform) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [-4.0, 5.0, 0.5]])
    np.testing.assert_allclose((T_a_b @ T_b_c).apply(points), T_a_b.apply(T_b_c.apply(points)), atol=1e-7)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_roll_pitch_and_yaw_come_back(roll: float, pitch: float, yaw: float) -> None:
    T = Transform.from_xyz_rpy((0, 0, 0), (roll, pitch, yaw))
    np.testing.assert_allclose(T.rpy, (roll, pitch, yaw), atol=1e-9)


def test_the_distance_is_metres_and_radians() -> None:
    a, b = Transform.from_xyz_yaw(0, 0, 0, 0.1), Transform.from_xyz_yaw(3, 4, 0, -0.2)
    assert a.distance_to(b) == (pytest.approx(5.0), pytest.approx(0.3))


@pytest.mark.parametrize(
    ("matrix", "sentence"),
    [
        (np.eye(3), "4x4"),
        (np.diag([2.0, 2, 2, 1]), "scales"),
        (np.diag([1.0, 1, -1, 1]), "mirrors"),
        (np.full((4, 4), np.nan), "finite"),
        (np.eye(4) + np.eye(4)[::-1] * [[0], [0], [0], [1]], "last row"),
    ],
)
def test_what_is_no_rigid_motion_is_refused_with_its_reason(matrix: np.ndarray, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Transform(matrix)


def test_a_transform_cannot_be_changed_through_its_source() -> None:
    matrix = np.eye(4)
    T = Transform(matrix)
    matrix[0, 3] = 5
    assert T.translation[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        T.matrix[0, 3] = 1
