"""Each doubt alone keeps a placement from being accepted."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from typing import Any

import pytest

from service.domain.acceptance import judge
from service.domain.evidence import PlacementEvidence
from tests.unit.placement_evidence import GOOD

DOUBTS: list[tuple[dict[str, Any], str]] = [
    ({"converged": False}, "not come to rest"),
    ({"inlier_share_of_structure": 0.5}, "50% of the scanned structure"),
    ({"inlier_share": 0.3}, "30% of all points"),
    ({"residual_median_m": 0.05}, "0.050 m off"),
    ({"residual_median_m": math.nan}, "off the map"),
    ({"tilt_rad": 0.2}, "tilted"),
    ({"contradicted_share": 0.2, "inlier_share_of_structure": 0.9}, "through"),
    ({"astray_share": 0.1, "upright_surfaces": 4}, "no room"),
    ({"weak_directions": ("along 30 deg",)}, "along 30 deg"),
    ({"upright_surfaces": 2}, "third wall"),
    ({"position_sensitivity_m": 0.1}, "too few sides"),
    ({"position_sensitivity_m": math.inf}, "too few sides"),
    ({"runner_up_inlier_share": 0.9, "runner_up_distance_m": 3.0, "runner_up_turn_rad": 3.1}, "Another pose"),
    ({"mirrored_inlier_share": 0.97, "mirrored_contradicted_share": 0.0}, "mirror image"),
    ({"slide_gain": 0.03, "slide_m": -0.3}, "0.30 m farther"),
    ({"starts_agreeing": 1}, "1 of 7 starts"),
    ({"moved_m": 8.0}, "from the rough pose"),
    ({"turned_rad": 1.5}, "from the rough pose"),
]


def test_nothing_against_it_is_accepted_with_reasons() -> None:
    judgement = judge(GOOD)
    assert judgement.verdict == "accepted"
    assert len(judgement.reasons) == 3
    lone = judge(replace(GOOD, slide_gain=-0.02, slide_m=0.15))
    assert lone.verdict == "accepted"
    assert "so does the scan" in lone.reasons[-1].detail


@pytest.mark.parametrize(("change", "words"), DOUBTS)
def test_one_doubt_is_enough_for_a_review(change: dict[str, Any], words: str) -> None:
    judgement = judge(replace(GOOD, **change))
    assert judgement.verdict == "needs-review"
    assert len(judgement.reasons) == 1
    assert words in judgement.reasons[0].detail


def test_a_runner_up_that_sees_through_walls_is_no_rival() -> None:
    rival = replace(GOOD, runner_up_inlier_share=0.93, runner_up_contradicted_share=0.0)
    assert judge(rival).verdict == "needs-review"
    assert judge(replace(rival, runner_up_contradicted_share=0.1)).verdict == "accepted"


def test_a_full_store_between_facing_walls_explains_little_and_is_accepted() -> None:
    store = replace(GOOD, inlier_share_of_structure=0.3, inlier_share=0.3, closed_directions=2)
    assert judge(store).verdict == "accepted"
    assert judge(replace(store, closed_directions=1)).verdict == "rejected"
    assert judge(replace(store, contradicted_share=0.02)).verdict == "rejected"
    assert judge(replace(store, astray_share=0.02)).verdict == "rejected"
    assert judge(replace(store, runner_up_inlier_share=0.25)).verdict == "needs-review"
    assert judge(replace(store, runner_up_inlier_share=0.15)).verdict == "accepted"


def test_objects_among_three_walls_hide_some_of_them() -> None:
    hall = replace(GOOD, inlier_share_of_structure=0.75, explained_share_at_top=0.99, upright_surfaces=3)
    assert judge(hall).verdict == "accepted"
    for change in (
        {"closed_directions": 0},
        {"upright_surfaces": 2},
        {"undrawn_wall_share": 0.1},
        {"explained_share_at_top": 0.94},
        {"astray_share": 0.02},
        {"contradicted_share": 0.002},
        {"inlier_share_of_structure": 0.6},
        {"runner_up_inlier_share": 0.6, "runner_up_distance_m": 3.0, "runner_up_turn_rad": 3.1},
        {"map_kind": "cloud", "residual_median_m": 0.05},
    ):
        assert judge(replace(hall, **change)).verdict == "needs-review"


def test_all_doubts_are_named_together() -> None:
    worst = replace(GOOD, converged=False, tilt_rad=0.2, upright_surfaces=1)
    assert len(judge(worst).reasons) == 3


@pytest.mark.parametrize("change", [{"inlier_share_of_structure": 0.1}, {"points_compared": 40}])
def test_what_explains_next_to_nothing_is_rejected(change: dict[str, Any]) -> None:
    assert judge(replace(GOOD, **change)).verdict == "rejected"


@pytest.mark.parametrize("score", [0.0, 0.0379, 0.5, math.inf])
def test_the_papers_threshold_is_shown_and_not_relied_on(score: float) -> None:
    assert judge(replace(GOOD, euclidean_fitness_score_m2=score)).verdict == "accepted"
    bad = replace(GOOD, euclidean_fitness_score_m2=score, upright_surfaces=2)
    assert judge(bad).verdict == "needs-review"


def test_a_cloud_may_be_noisier_than_faces() -> None:
    noisy = replace(GOOD, residual_median_m=0.025)
    assert judge(noisy).verdict == "needs-review"
    assert judge(replace(noisy, map_kind="cloud")).verdict == "accepted"


def test_evidence_becomes_json_with_every_member() -> None:
    value = json.loads(json.dumps(GOOD.to_json(), allow_nan=False))
    assert set(value) == {field.name for field in fields(PlacementEvidence)}
    assert value["weak_directions"] == []
    assert value["information_eigenvalues"][0] == 0.08


def test_a_number_that_is_not_finite_becomes_null() -> None:
    value = replace(GOOD, position_sensitivity_m=math.inf, yaw_sensitivity_rad=math.nan).to_json()
    assert value["position_sensitivity_m"] is None
    assert value["yaw_sensitivity_rad"] is None
    json.dumps(value, allow_nan=False)


def test_a_mirror_image_that_fits_as_well_asks_for_a_person() -> None:
    own = GOOD.inlier_share_of_structure
    image = replace(GOOD, mirrored_contradicted_share=GOOD.contradicted_share)
    for more, verdict in (
        (-0.02, "accepted"),
        (-0.001, "accepted"),
        (0.0, "needs-review"),
        (0.02, "needs-review"),
    ):
        assert judge(replace(image, mirrored_inlier_share=own + more)).verdict == verdict
    seen_through = replace(image, mirrored_inlier_share=own + 0.02, mirrored_contradicted_share=0.05)
    assert judge(seen_through).verdict == "accepted"
