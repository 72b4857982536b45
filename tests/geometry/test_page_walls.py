"""Vector pages read: walls by pen, by pairs of strokes and by filled areas, in many hands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from service.domain.errors import NoWallsFound
from tests.geometry.page_plans import CORNER, PAGE, a_page, a_plan, agreement
from worker.formats.linework_draft import LineworkDraft, Pen
from worker.geometry.drawing.linework.areas import entity_area, tangled_areas
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.linework.units import assumed_unit
from worker.geometry.drawing.page.read import read_page
from worker.geometry.drawing.page.sheet import draw_page
from worker.geometry.drawing.page.strips import find_pen_strips, joined
from worker.geometry.drawing.reading.reading import Reading
from worker.geometry.drawing.scale.decision import Scale, given


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("style", ["outlined", "filled", "compound"])
def test_faces_are_found_where_they_are_drawn(style: str, seed: int) -> None:
    plan = a_plan(seed)
    precision, recall = agreement(read_page(a_page(plan, 100, style=style), scale=given(0.1)), plan, 100)
    assert precision >= 0.97
    assert recall >= 0.97


@pytest.mark.parametrize("ratio", [75, 200])
def test_the_ratio_of_the_print_changes_nothing(ratio: float) -> None:
    plan = a_plan(21)
    reading = read_page(a_page(plan, ratio, style="outlined"), scale=given(ratio / 1000))
    precision, recall = agreement(reading, plan, ratio)
    assert min(precision, recall) >= 0.97


def test_windows_laid_over_filled_walls_in_white_are_gaps() -> None:
    plan = a_plan(31)
    page = a_page(plan, 100, style="masked")
    without = replace(page, kind=np.where(page.kind == "mask", "line", page.kind))
    lengths = [sum(w.length for w in read_page(p, scale=given(0.1)).walls) for p in (without, page)]
    assert lengths[0] - lengths[1] == pytest.approx(2 * 1.2, abs=0.35)


def test_one_pen_for_everything_still_gives_the_walls() -> None:
    plan = a_plan(41)
    reading = read_page(a_page(plan, 100, style="outlined", pens=(0.25, 0.25)), scale=given(0.1))
    precision, recall = agreement(reading, plan, 100)
    assert precision >= 0.8
    assert recall >= 0.93


def test_an_unknown_scale_gives_the_same_walls_in_units_of_the_page() -> None:
    plan = a_plan(51)
    reading = read_page(a_page(plan, 100, style="outlined"), scale=Scale("unknown", None, candidates=(0.1,)))
    assert reading.unit == "px"
    assert reading.sheet == (420.0, 297.0)
    precision, recall = agreement(reading.scaled(0.1), plan, 100)
    assert min(precision, recall) >= 0.97


def test_everything_else_is_set_aside_with_a_reason() -> None:
    page = a_page(a_plan(61), 100, style="outlined")
    reading = read_page(page, scale=given(0.1))
    walls = [i for i in range(len(page.kind)) if page.width[i] == 0.5 and i > 1]
    others = len(page.kind) - len(walls)
    assert len(reading.removed) >= others + len(page.texts) - 2
    assert all(r.reason for r in reading.removed)
    assert sum(r.layer == "text" for r in reading.removed) == len(page.texts)


def a_single_line_plan() -> Linework:
    draft = LineworkDraft(PAGE, most=1000)
    x, y = CORNER
    pen = Pen(width=1.0)
    draft.add([(x, y), (x + 200, y), (x + 200, y + 120), (x, y + 120)], pen=pen, closed=True)
    for at in (60.0, 130.0):
        draft.add([(x + at, y), (x + at, y + 70)], pen=pen)
    draft.add([(x, y + 70), (x + 170, y + 70)], pen=pen)
    return draft.finish(page_mm_per_unit=1.0)


def test_a_single_line_plan_is_read_as_pixels_in_its_place() -> None:
    reading = read_page(a_single_line_plan(), scale=given(0.1))
    assert "page-read-as-pixels" in [f.code for f in reading.findings]
    assert reading.sheet == pytest.approx((42.0, 29.7))
    points = np.vstack([w.centre for w in reading.walls])
    low, high = points.min(axis=0), points.max(axis=0)
    assert low == pytest.approx(np.array(CORNER) * 0.1, abs=0.15)
    assert high == pytest.approx(np.array([CORNER[0] + 200, CORNER[1] + 120]) * 0.1, abs=0.15)
    assert sum(w.length for w in reading.walls) == pytest.approx(64 + 14 + 17, rel=0.1)


def test_a_page_of_words_and_dashes_alone_has_no_walls() -> None:
    draft = LineworkDraft(PAGE, most=100)
    draft.add([(50, 50), (300, 50), (300, 200)], pen=Pen(width=0.2, dashed=True))
    with pytest.raises(NoWallsFound):
        read_page(draft.finish(page_mm_per_unit=1.0), scale=given(0.1))


def test_layers_that_say_wall_decide() -> None:
    page = a_page(a_plan(71), 100, style="outlined")
    named = replace(page, layer_names=("A-WALL", "A-FURN"), layer=(page.width < 0.4).astype(np.int64))
    by_name = read_page(named, scale=given(0.1))
    assert {x.name: x.role for x in by_name.layers} == {"A-WALL": "wall", "A-FURN": "furniture"}
    chosen = read_page(named, scale=given(0.1), wall_layers=["A-FURN"])
    assert total(chosen) != pytest.approx(total(by_name), rel=0.1)


def total(reading: Reading) -> float:
    return sum(w.length for w in reading.walls)


def test_strips_are_nearest_first_and_patterns_are_none() -> None:
    lines = [[(0, y), (5, y)] for y in (0.0, 0.12, 0.42, 0.54)]
    strips = find_pen_strips(np.array(lines, dtype=np.float64))
    assert sorted(round(a.area, 6) for a in strips.areas) == [0.6, 0.6]
    tiles = [[(0, 0.3 * k), (5, 0.3 * k)] for k in range(12)]
    assert find_pen_strips(np.array(tiles, dtype=np.float64)).length.sum() <= 5.0


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.5707963, 2.9])
def test_pieces_of_a_line_are_joined_whatever_its_direction(angle: float) -> None:
    cos, sin = math.cos(angle), math.sin(angle)
    t = np.array([(0.0, 1.0), (2.0, 1.0), (2.01, 3.0), (5.0, 6.0)])
    pieces = np.stack([np.stack([t * cos, t * sin], axis=2)], axis=0)[0]
    lengths = np.sort(np.hypot(*(joined(pieces)[:, 1] - joined(pieces)[:, 0]).T))
    assert lengths == pytest.approx([1.0, 3.0], abs=1e-3)


def test_a_hole_is_no_material() -> None:
    draft = LineworkDraft(PAGE, most=100)
    draft.add([(10, 10), (50, 10), (50, 40), (10, 40)], pen=Pen(filled=True))
    draft.add([(12, 12), (48, 12), (48, 38), (12, 38)], pen=Pen(filled=True), again=True)
    area = entity_area(draft.finish(page_mm_per_unit=1.0), 0, 0.1)
    assert area is not None
    assert area.area == pytest.approx(0.1**2 * (40 * 30 - 36 * 26))


def _turning(turns: int, *, points: int = 301, times: int = 1) -> Linework:
    """Return one filled outline of `points` sides, 40 about its middle, that goes round so often."""
    draft = LineworkDraft(PAGE, most=10_000)
    angle = np.tile(np.arange(points) * (2 * np.pi * turns / points), times)
    draft.add([(60 + 40 * np.cos(a), 60 + 40 * np.sin(a)) for a in angle], pen=Pen(filled=True))
    return draft.finish(page_mm_per_unit=1.0)


@pytest.mark.parametrize(("turns", "times"), [(1, 1), (1, 2), (1, 5), (7, 1)])
def test_an_outline_that_is_gone_round_again_or_crosses_itself_a_little_is_an_area(
    turns: int, times: int
) -> None:
    page = _turning(turns, times=times)
    area = entity_area(page, 0, 0.1)
    assert area is not None
    assert area.area == pytest.approx(16 * np.pi, rel=0.01)
    assert tangled_areas(page) == []


@pytest.mark.parametrize("turns", [9, 150])
def test_an_outline_that_crosses_itself_over_and_over_is_no_area_and_is_told(turns: int) -> None:
    page = _turning(turns)
    assert entity_area(page, 0, 0.1) is None
    assert [(one.code, one.values) for one in tangled_areas(page)] == [("areas-tangled", {"areas": 1})]


@pytest.mark.parametrize(("points", "is_area"), [(62, True), (63, True), (64, False), (65, False)])
def test_an_outline_of_few_sides_is_an_area_however_often_it_crosses_itself(
    points: int, *, is_area: bool
) -> None:
    page = _turning(11, points=points)
    assert len(page.ends) == points
    assert (entity_area(page, 0, 0.1) is not None) is is_area
    assert bool(tangled_areas(page)) is not is_area


@pytest.mark.parametrize("points", [127, 129, 255, 257, 385])
def test_a_side_may_meet_sixteen_others_however_many_are_asked_about_at_a_time(points: int) -> None:
    """Of a star that goes round k times, each side meets itself and 2 k others: 15 of 7 turns, 17 of 8."""
    assert entity_area(_turning(7, points=points), 0, 0.1) is not None
    assert entity_area(_turning(8, points=points), 0, 0.1) is None


def test_of_an_unknown_scale_the_best_candidate_counts_and_else_a_length_of_forty_metres() -> None:
    page = _turning(1)  # 80 across
    assert assumed_unit(page, Scale("unknown", None, ())) == pytest.approx(0.5, rel=1e-3)
    assert assumed_unit(page, Scale("unknown", None, (), (0.01, 0.02))) == 0.01
    assert assumed_unit(page, given(0.03)) == 0.03


def test_a_drawn_page_lies_where_its_strokes_are() -> None:
    draft = LineworkDraft(PAGE, most=100)
    draft.add([(100, 50), (200, 50)], pen=Pen(width=1.0))
    draft.add([(100, 80), (140, 80), (140, 90), (100, 90)], pen=Pen(filled=True))
    page = draft.finish(page_mm_per_unit=1.0)
    sheet = draw_page(page, np.ones(2, dtype=np.bool_), units_per_px=0.25, most_pixels=10_000_000)
    rows, columns = np.nonzero(sheet.grey < 128)
    x = sheet.origin[0] + (columns + 0.5) * sheet.units_per_px
    y = sheet.origin[1] + (sheet.grey.shape[0] - rows - 0.5) * sheet.units_per_px
    assert (x.min(), x.max()) == (pytest.approx(100, abs=0.7), pytest.approx(200, abs=0.7))
    assert (y.min(), y.max()) == (pytest.approx(49.5, abs=0.5), pytest.approx(90, abs=0.5))
    small = draw_page(page, np.ones(2, dtype=np.bool_), units_per_px=0.01, most_pixels=10_000)
    assert small.grey.size <= 40_000
