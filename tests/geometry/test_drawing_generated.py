"""Readings of generated plans in every style: walls found, clutter set aside, thickness right, doors open."""

import numpy as np
import pytest
import shapely

from tests.geometry.generated_plans import SCALE, Plan, draw_plan
from worker.geometry.drawing.raster.read import read_raster
from worker.geometry.drawing.reading.reading import Reading
from worker.geometry.drawing.scale.decision import given

STYLES = ["filled", "outlined", "hatched", "single-line"]
SEEDS = [1, 2, 3]


@pytest.fixture(scope="module", params=[(style, seed) for style in STYLES for seed in SEEDS], ids=str)
def case(request: pytest.FixtureRequest) -> tuple[str, Plan, Reading]:
    style, seed = request.param
    plan = draw_plan(style, seed)
    return style, plan, read_raster(plan.grey, scale=given(SCALE))


def centres(reading: Reading) -> shapely.Geometry:
    return shapely.MultiLineString([w.centre for w in reading.walls])


def test_walls_are_found_and_what_is_drawn_beside_them_is_not(case: tuple[str, Plan, Reading]) -> None:
    style, plan, reading = case
    assert reading.style == ("outlined" if style == "hatched" else style)
    truth = shapely.MultiLineString([[a, b] for a, b, _ in plan.walls]).intersection(plan.body.buffer(0.02))
    found = shapely.union_all(
        [shapely.LineString(w.centre).buffer(w.thickness / 2 + 0.1) for w in reading.walls]
    )
    assert truth.intersection(found).length >= 0.93 * truth.length
    lines = centres(reading)
    assert lines.intersection(truth.buffer(0.25)).length >= 0.93 * lines.length


def test_the_median_thickness_is_right_to_two_centimetres(case: tuple[str, Plan, Reading]) -> None:
    style, plan, reading = case
    if style == "single-line":
        assert {w.kind for w in reading.walls} == {"partition"}
        return
    errors = []
    for wall in reading.walls:
        if wall.length < 0.5:
            continue
        middle = shapely.LineString(wall.centre)
        nearest = min(
            plan.walls,
            key=lambda w: (
                shapely.LineString(w[:2]).hausdorff_distance(middle)
                + 10 * shapely.LineString(w[:2]).distance(middle.centroid)
            ),
        )
        errors.append(abs(wall.thickness - nearest[2]))
    assert float(np.median(errors)) <= 0.02


def test_doors_stay_open(case: tuple[str, Plan, Reading]) -> None:
    _, plan, reading = case
    lines = centres(reading)
    for door in plan.doors:
        opening = shapely.LineString(door).buffer(0.1, cap_style="flat")
        assert lines.intersection(opening).length <= 0.25 * shapely.LineString(door).length


def test_every_stroke_set_aside_has_a_layer_and_a_reason(case: tuple[str, Plan, Reading]) -> None:
    _, _, reading = case
    assert reading.removed
    assert all(r.layer and r.reason for r in reading.removed)
    assert all(0.0 < w.confidence <= 1.0 and w.reason for w in reading.walls)
