"""PCL's and Autoware's numbers against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worker.geometry.registration.fitness import (
    euclidean_fitness_score,
    nearest_voxel_transformation_likelihood,
    transformation_probability,
)
from worker.geometry.registration.ndt_map import build_ndt_map, gauss_constants

LATTICE = np.stack(np.meshgrid(*[np.arange(6) * 0.4] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def away(points: NDArray[np.float64], of: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the distance from each point to the nearest of others."""
    return np.asarray(KDTree(of).query(points)[0], dtype=np.float64)


def test_a_shift_by_less_than_half_the_spacing_is_the_score() -> None:
    shifted = LATTICE + np.array([0.1, 0.0, -0.05])
    assert euclidean_fitness_score(away(shifted, LATTICE)) == pytest.approx(0.0125, rel=1e-9)


def test_points_on_a_surface_sampled_at_v_score_v_squared_over_six() -> None:
    """The paper's 0.038 m^2 belongs to voxels of 0.4 m: a perfect fit gives 0.4^2 / 6 = 0.027 of it."""
    v = 0.4
    plane = np.stack(
        np.meshgrid(np.arange(40) * v, np.arange(40) * v, [0.0], indexing="ij"), axis=-1
    ).reshape(-1, 3)
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(4, 12, (200_000, 2)), np.zeros(200_000)])
    assert euclidean_fitness_score(away(points, plane)) == pytest.approx(v**2 / 6, rel=0.01)


def test_points_beyond_the_limit_are_left_out() -> None:
    points = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, -50.0]])
    assert euclidean_fitness_score(away(points, LATTICE), max_distance=1.0) == pytest.approx(0.01)
    assert euclidean_fitness_score(away(points[1:], LATTICE), max_distance=1.0) == np.inf


@pytest.mark.parametrize("bad", [np.zeros((4, 2)), np.array([0.0, np.nan]), np.array([np.inf])])
def test_other_shapes_and_values_are_defects(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"\(N,\) and finite"):
        euclidean_fitness_score(bad)


def test_tp_counts_every_point_and_nvtl_only_those_near_a_gaussian() -> None:
    rng = np.random.default_rng(1)
    cell = 0.5 + np.clip(rng.normal(size=(300, 3)) * 0.1, -0.4, 0.4)
    ndt_map = build_ndt_map(cell, 1.0)
    best = -gauss_constants(1.0)[0]
    points = np.vstack([ndt_map.means, [[50.0, 50.0, 50.0]]])
    assert transformation_probability(points, ndt_map) == pytest.approx(best / 2)
    assert nearest_voxel_transformation_likelihood(points, ndt_map) == pytest.approx(best)
    assert nearest_voxel_transformation_likelihood(points[1:], ndt_map) == 0.0
