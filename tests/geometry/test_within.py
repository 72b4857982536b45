"""Which points lie in a region, and which of a placed scan a layer takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from service.domain.layer_part import OUTLIER, REFERENCE, TARGET, WHOLE, LayerPart
from service.domain.region import Region
from worker.geometry.cloud.within import taken, within

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
POINTS = np.array([(1.0, 1.0, 0.5), (1.0, 1.0, 1.5), (3.0, 1.0, 0.5), (1.0, 1.0, 0.5), (5.0, 5.0, 0.0)])
LABELS = np.array([TARGET, REFERENCE, REFERENCE, OUTLIER, TARGET], dtype=np.uint8)


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        ({}, [0, 4]),
        ({"points": "all"}, [0, 1, 2, 4]),
        ({"include": [{"within": SQUARE}]}, [0, 1, 4]),
        ({"include": [{"within": SQUARE}], "exclude": [{"within": SQUARE, "z_max_m": 1.0}]}, [1, 4]),
        ({"points": "all", "exclude": [{"within": SQUARE, "z_min_m": 1.0, "z_max_m": 2.0}]}, [0, 2, 4]),
    ],
)
def test_a_part_is_the_target_and_what_a_person_adds_or_takes_off(
    said: dict[str, Any], wanted: list[int]
) -> None:
    part = LayerPart.from_json(said)
    assert np.flatnonzero(taken(part, POINTS, LABELS)).tolist() == wanted


def test_the_whole_has_no_outliers() -> None:
    assert np.flatnonzero(taken(WHOLE, POINTS, LABELS)).tolist() == [0, 1, 2, 4]


def test_a_polygon_with_a_notch_leaves_the_notch_out() -> None:
    notched = Region(((0, 0), (4, 0), (4, 4), (2, 1), (0, 4)))
    inside = within(notched, np.array([(2.0, 0.5, 0.0), (2.0, 2.0, 0.0), (0.5, 2.0, 0.0), (3.5, 2.0, 9.0)]))
    assert inside.tolist() == [True, False, True, True]


def test_two_regions_that_share_an_edge_hold_each_point_once() -> None:
    left, right = Region(((0, 0), (1, 0), (1, 2), (0, 2))), Region(((1, 0), (2, 0), (2, 2), (1, 2)))
    x = np.linspace(0.25, 1.75, 7)
    points = np.column_stack([x, np.ones(7), np.zeros(7)])
    assert (within(left, points).astype(int) + within(right, points)).tolist() == [1] * 7
