"""The neighbours that the grid finds against those of scipy's KD-tree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worker.geometry.registration.neighbours import NeighbourGrid


def a_room(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points on walls, floor and in the air, and unit normals of any direction."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 8.0, (4000, 3)) * (1.0, 1.0, 0.4)
    points[np.arange(3500), rng.integers(0, 3, 3500)] = rng.normal(0.0, 0.01, 3500)
    normals = rng.normal(size=points.shape)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("reach", [0.1, 0.6, np.inf])
@pytest.mark.parametrize("cell", [0.07, 0.2, 3.0, 100.0])
def test_the_nearest_is_that_of_a_tree(reach: float, cell: float) -> None:
    points, _ = a_room(1)
    places = np.random.default_rng(2).uniform(-2.0, 10.0, (800, 3))
    distance, index = NeighbourGrid.of(points, cell=cell).nearest(places, reach=reach)
    expected, at = KDTree(points).query(places, distance_upper_bound=reach)
    np.testing.assert_allclose(distance, expected, rtol=1e-12)
    np.testing.assert_array_equal(index, np.where(at < len(points), at, -1))


def test_normals_count_as_three_more_dimensions() -> None:
    points, normals = a_room(3)
    places, looks = a_room(4)
    grid = NeighbourGrid.of(points, normals)
    distance, index = grid.nearest(places, looks, reach=np.inf, weight=0.5, most=0.4)
    tree = KDTree(np.hstack([points, 0.5 * normals]))
    expected, at = tree.query(np.hstack([places, 0.5 * looks]), distance_upper_bound=0.4)
    np.testing.assert_allclose(distance, expected, rtol=1e-12)
    np.testing.assert_array_equal(index, np.where(at < len(points), at, -1))
    near, index = grid.nearest(places, looks, reach=0.1, weight=0.5, most=0.4)
    found = index >= 0
    assert found.any()
    assert (np.linalg.norm(points[index[found]] - places[found], axis=1) < 0.1).all()
    assert (near[found] >= np.asarray(expected)[found] - 1e-12).all()


@pytest.mark.parametrize("wide", [0.02, 1.0, 50.0])
def test_spreads_are_those_of_the_nearest_twelve(wide: float) -> None:
    points = a_room(5)[0] * wide
    values, vectors = NeighbourGrid.with_cells_of_some(points).spreads(neighbours=12)
    _, near = KDTree(points).query(points, k=12)
    off = points[near] - points[near].mean(axis=1, keepdims=True)
    spread = np.einsum("nki,nkj->nij", off, off)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(spread), atol=1e-10 * np.abs(spread).max())
    np.testing.assert_allclose(
        np.einsum("nij,nj,nkj->nik", vectors, values, vectors), spread, atol=1e-9 * wide**2
    )


def test_few_points_have_few_neighbours() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    values, _ = NeighbourGrid.with_cells_of_some(points).spreads(neighbours=12)
    np.testing.assert_allclose(values, [[0.0, 0.0, 0.5]] * 2, atol=1e-12)
