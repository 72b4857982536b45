"""The voxel grid filter: one point a voxel, whichever way a reader rounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from service.domain.errors import CoordinatesTooLarge
from worker.geometry.cloud import voxel_grid
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.cloud.voxel_grid import Keep, filter_cloud, voxel_grid_filter, voxel_index

clouds = npst.arrays(
    np.float64,
    st.tuples(st.integers(1, 60), st.sampled_from([2, 3])),
    elements=st.floats(-500.0, 500.0, allow_nan=False, width=32),
)
sizes = st.sampled_from([0.025, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5])
keeps = st.sampled_from(["centroid", "nearest-to-centre"])


@given(points=clouds, size=sizes, keep=keeps)
@settings(deadline=None)
def test_the_voxels_of_the_answer_are_the_voxels_of_the_input_each_once(
    points: NDArray[np.float64], size: float, keep: Keep
) -> None:
    kept = voxel_grid_filter(points, size, keep=keep)
    written = kept.astype(np.float32)
    assert np.array_equal(written.astype(np.float64), kept)
    in_float64 = voxel_index(kept, size)
    in_float32 = np.floor(written / np.float32(size)).astype(np.int64)
    expected = np.unique(voxel_index(points, size), axis=0)
    assert np.array_equal(np.unique(in_float64, axis=0), expected)
    assert len(in_float64) == len(expected)
    assert np.array_equal(in_float32, in_float64)


@given(points=clouds, size=sizes)
@settings(deadline=None)
def test_filtering_again_changes_nothing(points: NDArray[np.float64], size: float) -> None:
    once = voxel_grid_filter(points, size)
    assert np.array_equal(voxel_grid_filter(once, size), once)


@given(points=clouds, size=sizes, seed=st.integers(0, 99))
@settings(deadline=None)
def test_the_order_of_the_input_does_not_matter(points: NDArray[np.float64], size: float, seed: int) -> None:
    shuffled = np.random.default_rng(seed).permutation(points)
    kept, again = voxel_grid_filter(points, size), voxel_grid_filter(shuffled, size)
    assert np.allclose(kept, again, atol=1e-4 * size + 1e-4)


def test_the_centroid_is_the_mean_and_the_nearest_is_a_point_itself() -> None:
    points = np.array([[0.1, 0.1], [0.2, 0.3], [0.9, 0.8], [1.5, 0.5]])
    centroid = voxel_grid_filter(points, 1.0)
    nearest = voxel_grid_filter(points, 1.0, keep="nearest-to-centre")
    assert np.allclose(centroid, [[0.4, 0.4], [1.5, 0.5]], atol=1e-6)
    assert np.allclose(nearest, [[0.2, 0.3], [1.5, 0.5]], atol=1e-6)


def test_a_filtered_layer_has_one_label() -> None:
    cloud = PointCloud.of(np.random.default_rng(1).uniform(0, 2, (500, 3)))
    kept = filter_cloud(cloud, 0.5, label=Label.LAYER)
    assert len(kept) == 64
    assert set(kept.labels.tolist()) == {4}


def test_coordinates_that_float32_cannot_tell_apart_are_refused() -> None:
    with pytest.raises(CoordinatesTooLarge, match="nearer to its origin"):
        voxel_grid_filter(np.array([[9e5, 0.0, 0.0]]), 0.025)


def test_a_voxel_without_edge_is_a_defect() -> None:
    with pytest.raises(ValueError, match="positive edge"):
        voxel_grid_filter(np.zeros((1, 3)), 0.0)


@pytest.mark.parametrize("reach", [3, 1 << 20, 1 << 40])
def test_voxels_come_in_one_order_however_far_they_reach(rng: np.random.Generator, reach: int) -> None:
    index = rng.integers(-reach, reach, (2_000, 3))
    assert np.array_equal(voxel_grid._order(index), np.lexsort(index.T))
