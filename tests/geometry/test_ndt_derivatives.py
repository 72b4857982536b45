"""Gradient and Hessian of the NDT score against finite differences, and the score against its definition."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from worker.geometry.registration.cell_covariance import CellCovariance
from worker.geometry.registration.derivatives import derivatives, score_points
from worker.geometry.registration.ndt import rotation_matrix
from worker.geometry.registration.ndt_map import NdtMap, build_ndt_map, gauss_constants

# Clusters two cells apart: no point comes near the distance at which a Gaussian begins to count.
CENTRES = np.array([[0.5, 0.5, 0.5], [5.5, 0.5, 0.5], [0.5, 5.5, 0.5], [2.5, 2.5, 4.5]])


def scene(seed: int) -> tuple[NDArray[np.float64], NdtMap]:
    """Return source points and the map of four flat clusters."""
    rng = np.random.default_rng(seed)
    spread = rng.normal(size=(4, 200, 3)) * [0.15, 0.1, 0.03]
    target = (CENTRES[:, None] + np.clip(spread, -0.49, 0.49)).reshape(-1, 3)
    source = (CENTRES[:, None] + rng.normal(size=(4, 60, 3)) * 0.08).reshape(-1, 3)
    return source, build_ndt_map(target, 1.0)


def moved(
    points: NDArray[np.float64], xi: NDArray[np.float64], centre: NDArray[np.float64]
) -> NDArray[np.float64]:
    return (points - centre) @ rotation_matrix(xi[3:]).T + centre + xi[:3]


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000), centre=st.tuples(*[st.floats(-3, 3)] * 3))
def test_gradient_and_hessian_are_those_of_the_score(seed: int, centre: tuple[float, float, float]) -> None:
    source, ndt_map = scene(seed)
    c = np.array(centre)

    def score(xi: NDArray[np.float64]) -> float:
        return derivatives(moved(source, xi, c), ndt_map, centre=c)[0]

    _, gradient, hessian = derivatives(source, ndt_map, centre=c)
    h = 1e-4
    steps = h * np.eye(6)
    expected_g = np.array([(score(e) - score(-e)) / (2 * h) for e in steps])
    expected_H = np.array(
        [
            [(score(a + b) - score(a - b) - score(b - a) + score(-a - b)) / (4 * h * h) for b in steps]
            for a in steps
        ]
    )
    np.testing.assert_allclose(gradient, expected_g, atol=2e-3 * np.abs(expected_g).max())
    np.testing.assert_allclose(hessian, expected_H, atol=2e-3 * np.abs(expected_H).max())
    np.testing.assert_array_equal(hessian, hessian.T)


def test_one_point_and_one_gaussian_give_equation_6_9() -> None:
    rng = np.random.default_rng(0)
    cluster = 0.5 + np.clip(rng.normal(size=(500, 3)) * [0.2, 0.1, 0.05], -0.49, 0.49)
    ndt_map = build_ndt_map(cluster, 1.0)
    assert len(ndt_map) == 1
    d1, d2 = gauss_constants(1.0)
    point = np.array([[0.6, 0.45, 0.52]])
    off = point[0] - cluster.mean(axis=0)
    expected = -d1 * math.exp(-0.5 * d2 * off @ np.linalg.inv(np.cov(cluster.T)) @ off)
    total, best = score_points(point, ndt_map)
    assert derivatives(point, ndt_map, centre=np.zeros(3))[0] == pytest.approx(expected, rel=1e-9)
    assert total[0] == best[0] == pytest.approx(expected, rel=1e-9)


def test_a_perfect_point_scores_the_documented_maximum() -> None:
    """The highest score a Gaussian gives is -d1: 0.704 at 0.5 m, 2.217 at 1 m, 4.197 at 2 m."""
    assert [round(-gauss_constants(size)[0], 3) for size in (0.5, 1.0, 2.0)] == [0.704, 2.217, 4.197]


def test_covariance_is_exact_and_flat_cells_are_thickened_to_a_hundredth() -> None:
    rng = np.random.default_rng(1)
    solid = rng.uniform(0.05, 0.95, (400, 3))
    flat = rng.uniform(0.05, 0.95, (400, 3)) * [1, 1, 0] + [2.0, 0.0, 0.5]
    ndt_map = build_ndt_map(np.vstack([solid, flat]), 1.0)
    b = ndt_map.inverse_covariances
    inverse = np.array([[[r[0], r[1], r[2]], [r[1], r[3], r[4]], [r[2], r[4], r[5]]] for r in b])
    np.testing.assert_allclose(np.linalg.inv(inverse[0]), np.cov(solid.T), rtol=1e-9)
    values = np.linalg.eigvalsh(np.linalg.inv(inverse[1]))
    assert values[0] == pytest.approx(0.01 * values[2], rel=1e-9)
    assert abs(ndt_map.normals[1][2]) == pytest.approx(1.0, abs=1e-9)


def test_cells_of_fewer_than_six_points_and_of_one_place_are_left_out() -> None:
    few = np.random.default_rng(2).uniform(0, 1, (5, 3))
    same = np.full((50, 3), 3.5)
    assert len(build_ndt_map(np.vstack([few, same]), 1.0)) == 0


def test_a_point_sees_the_means_within_one_resolution_and_no_others() -> None:
    rng = np.random.default_rng(3)
    target = rng.uniform(-4, 4, (20_000, 3))
    ndt_map = build_ndt_map(target, 1.0)
    points = rng.uniform(-5, 5, (300, 3))
    d1, d2 = ndt_map.gauss
    expected = np.zeros(len(points))
    for n, p in enumerate(points):
        for mean, b in zip(ndt_map.means, ndt_map.inverse_covariances, strict=True):
            d = p - mean
            if d @ d <= 1.0:
                C = np.array([[b[0], b[1], b[2]], [b[1], b[3], b[4]], [b[2], b[4], b[5]]])
                expected[n] -= d1 * math.exp(-0.5 * d2 * d @ C @ d)
    np.testing.assert_allclose(score_points(points, ndt_map)[0], expected, rtol=1e-9, atol=1e-12)


def test_points_far_from_everything_score_nothing() -> None:
    _, ndt_map = scene(0)
    far = np.array([[1e9, 0.0, 0.0], [-1e12, 5.0, 5.0], [100.0, 100.0, 100.0]])
    score, gradient, hessian = derivatives(far, ndt_map, centre=np.zeros(3))
    assert score == 0.0
    assert not gradient.any()
    assert not hessian.any()


@pytest.mark.parametrize("resolution", [0.0, -1.0, math.nan, math.inf])
def test_a_cell_without_a_size_is_a_defect(resolution: float) -> None:
    with pytest.raises(ValueError, match="edge is positive"):
        build_ndt_map(np.zeros((10, 3)), resolution)


def test_points_beyond_the_key_space_are_a_defect() -> None:
    with pytest.raises(ValueError, match="reach farther"):
        build_ndt_map(np.array([[2e6, 0.0, 0.0]] * 10), 1.0)


@pytest.mark.parametrize(
    ("covariance", "thin", "wide"),
    [
        ("exact", 0.02 / 7, 0.32 / 7),
        ("pcl-1.11", (0.02 + 1.0) / 8 * 7 / 8, (0.32 + 1.0) / 8 * 7 / 8),
        ("autoware", (0.02 + 1.0) / 7, (0.32 + 1.0) / 7),
    ],
)
def test_a_cells_covariance_is_what_the_robots_ndt_makes_of_it(
    covariance: CellCovariance, thin: float, wide: float
) -> None:
    """Eight corners of a box 0.4 x 0.4 x 0.1 m: the sums of squares are 0.32, 0.32 and 0.02 m^2."""
    corners = np.array(list(itertools.product((-0.2, 0.2), (-0.2, 0.2), (-0.05, 0.05)))) + 0.5
    (cell,) = build_ndt_map(corners, 1.0, covariance=covariance).inverse_covariances
    np.testing.assert_allclose(cell, [1 / wide, 0.0, 0.0, 1 / wide, 0.0, 1 / thin], atol=1e-9)
