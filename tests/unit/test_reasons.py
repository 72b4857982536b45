"""A reason has a code that programs go by, the measures that its sentence shows, and the sentence."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import pytest

from service.domain.acceptance import judge
from service.domain.acceptance_table import SUPPORTS, TABLE
from service.domain.reasons import UNSPECIFIED, Reason, code_of, kept_reasons
from tests.unit.placement_evidence import GOOD

ROWS = {row.code: row for row in TABLE if row.sentence}

DOUBTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "few-points": ({"points_compared": 40}, {"points_compared": 40, "limit_points": 100}),
    "another-place": (
        {"inlier_share_of_structure": 0.2},
        {"inlier_share_of_structure": 0.2, "limit_share": 0.35, "inlier_distance_m": 0.1},
    ),
    "not-at-rest": ({"converged": False}, {"converged": False, "limit_truth": 1}),
    "structure-unexplained": (
        {"inlier_share_of_structure": 0.6, "explained_share_at_top": 0.5},
        {"inlier_share_of_structure": 0.6, "limit_share": 0.9},
    ),
    "points-unexplained": ({"inlier_share": 0.3}, {"inlier_share": 0.3, "limit_share": 0.4}),
    "residual": ({"residual_median_m": 0.09}, {"residual_median_m": 0.09, "limit_m": 0.02}),
    "seen-through-walls": ({"contradicted_share": 0.1}, {"contradicted_share": 0.1, "limit_share": 0.0015}),
    "astray": ({"astray_share": 0.3}, {"astray_share": 0.3, "limit_share": 0.04}),
    "tilted": ({"tilt_rad": 0.2}, {"tilt_rad": 0.2, "limit_rad": 0.08726646259971647}),
    "not-held": (
        {"weak_directions": ("z", "yaw")},
        {"weak_directions_count": 2, "limit_motions": 0, "weak_directions": ("z", "yaw")},
    ),
    "few-walls": ({"upright_surfaces": 1}, {"upright_surfaces": 1, "limit_surfaces": 3}),
    "sensitive": ({"position_sensitivity_m": 0.2}, {"position_sensitivity_m": 0.2, "limit_m": 0.045}),
    "lone-wall": (
        {"slide_gain": 0.03, "slide_m": -0.3},
        {"slide_gain_share": 0.03, "limit_share": 0.01, "slide_m": -0.3},
    ),
    "runner-up": (
        {"runner_up_inlier_share": 0.94, "runner_up_distance_m": 2.0, "runner_up_turn_rad": 0.5},
        {"limit_share": 0, "runner_up_distance_m": 2.0, "runner_up_turn_rad": 0.5},
    ),
    "mirror-image": (
        {"mirrored_inlier_share": 0.97, "mirrored_contradicted_share": 0.0},
        {"limit_share": -0.0005},
    ),
    "starts-disagree": (
        {"starts": 7, "starts_agreeing": 1},
        {"starts_agreeing_share": 1 / 7, "limit_share": 0.4, "starts": 7, "starts_agreeing": 1},
    ),
    "moved-far": ({"moved_m": 8.0}, {"moved_m": 8.0, "limit_m": 3.5, "turned_rad": GOOD.turned_rad}),
    "turned-far": ({"turned_rad": 1.5}, {"turned_rad": 1.5, "limit_rad": 0.8726646259971648}),
}


def test_each_sentence_of_the_table_has_a_doubt_here() -> None:
    assert set(DOUBTS) == set(ROWS)


@pytest.mark.parametrize("code", DOUBTS)
def test_a_doubt_has_the_rows_code_its_measure_and_its_limit(code: str) -> None:
    change, values = DOUBTS[code]
    (reason,) = [one for one in judge(replace(GOOD, **change)).reasons if one.code == code]
    assert {name: reason.values[name] for name in values} == values
    row = ROWS[code]
    assert {row.measure_key, row.limit_key} <= set(reason.values)
    assert reason.where is None
    assert code_of(reason.detail) in {code, "moved-far"}  # two rows share one sentence


def test_an_accepted_pose_rests_on_what_is_told() -> None:
    told = judge(GOOD).reasons
    assert [one.code for one in told] == ["structure-on-the-map", "held-by-surfaces", "starts-agree"]
    assert [dict(one.values) for one in told] == [
        {
            "inlier_share_of_structure": GOOD.inlier_share_of_structure,
            "residual_median_m": GOOD.residual_median_m,
        },
        {"upright_surfaces": GOOD.upright_surfaces},
        {"starts_agreeing": GOOD.starts_agreeing, "starts": GOOD.starts},
    ]
    others = judge(replace(GOOD, starts=0, slide_gain=-0.02, slide_m=0.15)).reasons[2:]
    assert [one.code for one in others] == ["no-rival", "lone-wall-unchecked"]
    assert all(code_of(one.detail) == one.code for one in (*told, *others))
    assert len({one.code for one in SUPPORTS} | set(ROWS)) == len(SUPPORTS) + len(ROWS)


def test_two_rows_of_one_sentence_are_one_reason() -> None:
    (reason,) = judge(replace(GOOD, moved_m=8.0, turned_rad=1.5)).reasons
    assert (reason.code, reason.values["moved_m"], reason.values["turned_rad"]) == ("moved-far", 8.0, 1.5)


def test_the_names_of_values_have_no_other_unit_than_si() -> None:
    names = {name for change, _ in DOUBTS.values() for one in judge(replace(GOOD, **change)).reasons
             for name in one.values}  # fmt: skip
    assert not [name for name in names if re.search("_(cm|mm|deg)$", name)]


def test_sentences_of_earlier_versions_are_reasons() -> None:
    sentence = "Only 2 of 7 starts ended at this pose."
    rows = [sentence, "The walls are purple.", {"code": "astray", "detail": "There."}, 7]
    assert kept_reasons(rows) == [
        {"code": "starts-disagree", "values": {}, "where": None, "detail": sentence},
        {"code": UNSPECIFIED, "values": {}, "where": None, "detail": "The walls are purple."},
        {"code": "astray", "detail": "There."},
        {"code": UNSPECIFIED, "values": {}, "where": None, "detail": "7"},
    ]
    assert kept_reasons(None) == []
    assert Reason("astray", detail="There.").to_json() == {
        "code": "astray",
        "values": {},
        "where": None,
        "detail": "There.",
    }
