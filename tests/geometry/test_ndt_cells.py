"""The cells of an NDT map against a plain count, and the compiled eigenvalues against LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from worker.geometry.registration.cell_moments import cell_moments
from worker.geometry.registration.derivatives import score_points
from worker.geometry.registration.ndt_map import build_ndt_map
from worker.geometry.registration.symmetric import eigen


@pytest.mark.parametrize("reach", [3.0, 90.0, 4000.0])
def test_every_cell_has_the_moments_of_its_points(reach: float) -> None:
    rng = np.random.default_rng(7)
    points = rng.uniform(-reach, reach, (60_000, 3)) * (1.0, 0.7, 0.1)
    moments = cell_moments(points, 0.5)
    numbers = np.floor(points / 0.5).astype(np.int64)
    cells, member, counts = np.unique(numbers, axis=0, return_inverse=True, return_counts=True)
    order = np.lexsort(moments.cells.T[::-1])
    np.testing.assert_array_equal(moments.cells[order], cells)
    np.testing.assert_array_equal(moments.counts[order], counts)
    sums = [np.bincount(member.ravel(), weights=points[:, k]) for k in range(3)]
    np.testing.assert_allclose(moments.means[order], np.column_stack(sums) / counts[:, None], atol=1e-9)
    fullest = int(np.argmax(counts))
    own = points[member.ravel() == fullest]
    if len(own) > 1:
        expected = np.cov(own.T)[np.triu_indices(3)]
        np.testing.assert_allclose(moments.covariances[order][fullest], expected, atol=1e-12)


def test_cells_do_not_depend_on_where_points_are_cut_off() -> None:
    points = np.random.default_rng(3).uniform(-40.0, 40.0, (50_000, 3))
    every, some = cell_moments(points, 2.0), cell_moments(points, 2.0, least=3)
    kept = every.counts >= 3
    assert 0 < kept.sum() < len(every)
    for name in ("cells", "counts", "means", "covariances"):
        np.testing.assert_array_equal(getattr(some, name), getattr(every, name)[kept])


@pytest.mark.parametrize("far", [2.0**21, np.nan, -np.inf])
def test_a_point_out_of_reach_is_refused(far: float) -> None:
    points = np.zeros((1000, 3))
    points[500, 1] = far
    with pytest.raises(ValueError, match="farther than"):
        cell_moments(points, 1.0)


def test_a_point_finds_all_cells_within_the_resolution() -> None:
    rng = np.random.default_rng(11)
    target, source = rng.uniform(-9.0, 9.0, (40_000, 3)), rng.uniform(-11.0, 11.0, (500, 3))
    ndt_map = build_ndt_map(target, 1.0)
    d1, d2 = ndt_map.gauss
    off = source[:, None] - ndt_map.means[None]
    b = ndt_map.inverse_covariances
    full = b[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
    m = np.einsum("nci,cij,ncj->nc", off, full, off)
    each = np.where(np.sum(off**2, axis=2) <= 1.0, -d1 * np.exp(-0.5 * d2 * m), 0.0)
    total, most = score_points(source, ndt_map)
    np.testing.assert_allclose(total, each.sum(axis=1), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(most, each.max(axis=1), rtol=1e-9, atol=1e-12)


@settings(max_examples=200, deadline=None)
@given(arrays(np.float64, (3, 3), elements=st.floats(-1e3, 1e3)), st.sampled_from([0, 1, 2, 3]))
def test_eigenvalues_and_vectors_are_those_of_lapack(half: np.ndarray, rank: int) -> None:
    half[:, rank:] = 0.0
    matrix = half @ half.T
    values, vectors = np.zeros(3), np.zeros((3, 3))
    eigen(matrix[np.triu_indices(3)], values, vectors)
    size = max(np.abs(matrix).max(), 1e-300)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), atol=1e-11 * size)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(vectors * values @ vectors.T, matrix, atol=1e-11 * size)
