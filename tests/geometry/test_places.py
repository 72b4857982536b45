"""Places told apart by one number each, and what stands on them: outliers and levels of odd clouds."""

from __future__ import annotations

import numpy as np
import pytest

from service.domain.errors import CoordinatesTooLarge
from tests.files import room
from worker.geometry.cloud.places import distinct_places, row_keys, smallest_that_fits
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.file_scan import FileScan, Statement
from worker.geometry.scan.outliers import find_outliers
from worker.geometry.scan.surface_sample import sample_surfaces
from worker.geometry.scan.upright import _FARTHEST, make_upright


def test_equal_rows_have_equal_keys_and_others_another(rng: np.random.Generator) -> None:
    rows = np.concatenate([rng.integers(-9, 9, (5_000, 3)), rng.integers(-(1 << 62), 1 << 62, (5_000, 3))])
    _, expected = np.unique(rows, axis=0, return_inverse=True)
    _, found = np.unique(row_keys(rows), return_inverse=True)
    assert len(set(zip(expected.tolist(), found.tolist(), strict=True))) == expected.max() + 1
    assert found.max() == expected.max()


def test_the_first_point_at_each_place_is_kept_in_order() -> None:
    points = np.array([[1.0, 2, 3], [0.0, 0, 0], [1, 2, 3], [-0.0, 0.0, -0.0], [1, 2, 3.0000001]])
    first, place = distinct_places(points)
    assert first.tolist() == [0, 1, 4]
    assert place.tolist() == [0, 1, 0, 1, 2]


@pytest.mark.parametrize("threshold", [0, 1, 2, 3, 17, 1000])
def test_the_smallest_step_that_fits_is_found(threshold: int) -> None:
    asked: list[int] = []

    def count(step: int) -> int:
        asked.append(step)
        return 0 if step >= threshold else 10

    assert smallest_that_fits(count, 9) == threshold
    assert len(asked) <= 2 * int(np.log2(threshold + 1)) + 3


def test_points_at_one_place_hide_no_outlier_and_are_none() -> None:
    points = np.concatenate([room(20_000), np.repeat([[0.0, 2.0, 1.0]], 50_000, axis=0)])
    points[17] = (3.0, 2.0, 9.0)
    assert np.flatnonzero(find_outliers(points)).tolist() == [17]


def test_as_many_copies_as_neighbours_are_wanted_make_no_company() -> None:
    points = np.concatenate([room(20_000), np.repeat([[3.0, 2.0, 9.0]], 12, axis=0)])
    assert np.flatnonzero(find_outliers(points)).tolist() == list(range(20_000, 20_012))


@pytest.mark.parametrize("stray", [1e3, 1e6, 1e12, 1e18])
def test_one_stray_point_leaves_a_sample_of_the_room(stray: float) -> None:
    points = np.concatenate([room(20_000), [[stray, -stray, stray]]])
    sample = sample_surfaces(points)
    assert 1 < len(sample.points) <= 25_000
    assert np.isfinite(sample.normals).all()


def a_room_with(far: float, *, count: int) -> FileScan:
    points = room(20_000)
    points = np.concatenate([points, np.add(room(count) * 0.1, [far, 0.0, 0.0])])
    return FileScan(PointCloud.of(points), "PLY", Statement(metres_per_unit=1.0, said_by="the test"))


def test_a_scan_may_reach_as_far_as_floats_tell_voxels_apart() -> None:
    near = make_upright(a_room_with(_FARTHEST * 0.99, count=20_000))
    assert np.abs(near.scan.points).max() < _FARTHEST
    with pytest.raises(CoordinatesTooLarge, match="unit"):
        make_upright(a_room_with(_FARTHEST * 2.02, count=20_000))
