"""Each number of acceptance turns a verdict: evidence on either side of it, written down, never computed.

A fact names a row of the table, the regimes in which it holds, and what is measured within 5 % of the limit
on its right and on its wrong side (a count: one apart). All else is evidence that nothing speaks against.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import pytest

from service.domain.acceptance import judge
from service.domain.acceptance_table import FACTORS, TABLE
from tests.unit.placement_evidence import CLEAN

REGIMES = ("faces", "cloud", "furnished", "closed")
MOST = ("faces", "cloud", "furnished")


class Fact(NamedTuple):
    """Hold a member of the evidence on the right and the wrong side of a row's limit, and what is said then.

    `right` says what a placement is on the right side, where another limit speaks against it; `also` holds
    members that are the same on both sides.
    """

    code: str
    regimes: tuple[str, ...]
    member: str
    kept: Any
    broken: Any
    words: str
    wrong: str = "needs-review"
    right: str = "accepted"
    also: dict[str, Any] = {}  # noqa: RUF012 - never changed


SHARE, RIVAL, IMAGE = "inlier_share_of_structure", "runner_up_inlier_share", "mirrored_inlier_share"
NOT_FURNISHED, NOT_CLOSED = "75% of the scanned structure lies on the map; 90%", "Only 30% of the scanned"


def _seen(share: float, seen_through: float) -> dict[str, Any]:
    """Return a pose that explains so much, and how much is seen through walls at its runner-up."""
    return {
        SHARE: share,
        "runner_up_contradicted_share": seen_through,
        "runner_up_distance_m": 3.0,
        "runner_up_turn_rad": math.pi,
    }


_ANOTHER = "Another pose, 3.00 m and 180.0 degrees away"

FACTS = [
    Fact("few-points", REGIMES, "points_compared", 105, 95, "Only 95 points", "rejected"),
    Fact("another-place", MOST, SHARE, 0.3675, 0.3325, "Only 33% of the", "rejected", "needs-review"),
    Fact("not-at-rest", REGIMES, "converged", True, False, "not come to rest"),
    Fact("structure-unexplained", ("faces",), SHARE, 0.945, 0.855, "lies on the map; 90% are expected"),
    Fact("structure-unexplained", ("cloud",), SHARE, 0.63, 0.57, "lies on the map; 60% are expected"),
    Fact("structure-unexplained", ("furnished",), SHARE, 0.6825, 0.6175, "lies on the map; 65% are expected"),
    Fact("structure-unexplained", ("closed",), SHARE, 0.1575, 0.1425, "lies on the map; 15% are expected"),
    Fact("points-unexplained", MOST, "inlier_share", 0.42, 0.38, "all points lie on the map; 40% are"),
    Fact("points-unexplained", ("closed",), "inlier_share", 0.2625, 0.2375, "lie on the map; 25% are"),
    Fact("residual", ("faces", "furnished"), "residual_median_m", 0.019, 0.021, "lie 0.021 m off"),
    Fact("residual", ("cloud",), "residual_median_m", 0.0285, 0.0315, "lie 0.032 m off"),
    Fact("residual", ("closed",), "residual_median_m", 0.038, 0.042, "lie 0.042 m off"),
    Fact("seen-through-walls", MOST, "contradicted_share", 0.001425, 0.001575, "0.2% of the points would"),
    Fact("seen-through-walls", ("closed",), "contradicted_share", 0.001425, 0.001575, NOT_CLOSED, "rejected"),
    Fact("astray", ("faces", "cloud"), "astray_share", 0.038, 0.042, "4% of the scanned structure stands in"),
    Fact("astray", ("furnished",), "astray_share", 0.0095, 0.0105, NOT_FURNISHED),
    Fact("astray", ("closed",), "astray_share", 0.0095, 0.0105, NOT_CLOSED, "rejected"),
    Fact("tilted", REGIMES, "tilt_rad", math.radians(4.75), math.radians(5.25), "tilted by 5.2 degrees"),
    Fact("closed-directions", ("furnished",), "closed_directions", 1, 0, NOT_FURNISHED),
    Fact("closed-directions", ("closed",), "closed_directions", 2, 1, NOT_CLOSED, "rejected"),
    Fact("wall-undrawn", ("furnished",), "undrawn_wall_share", 0.0665, 0.0735, NOT_FURNISHED),
    Fact("top-unexplained", ("furnished",), "explained_share_at_top", 0.97, 0.96, NOT_FURNISHED),
    Fact("top-unexplained", ("closed",), "explained_share_at_top", 0.945, 0.855, NOT_CLOSED, "rejected"),
    Fact("not-held", REGIMES, "weak_directions", (), ("along 30 deg",), "pose in: along 30 deg."),
    Fact("few-walls", MOST, "upright_surfaces", 3, 2, "rests on 2 upright surfaces; with fewer than 3"),
    Fact("sensitive", ("faces", "cloud"), "position_sensitivity_m", 0.0428, 0.0472, "it is 4.7 cm off"),
    Fact("sensitive", ("furnished", "closed"), "position_sensitivity_m", 0.057, 0.063, "it is 6.3 cm off"),
    Fact("lone-wall", REGIMES, "slide_gain", 0.0095, 0.0105, "lie on the map 0.30 m farther",
         also={"slide_m": -0.3}),
    Fact("runner-up", REGIMES, RIVAL, 0.745, 0.755, _ANOTHER, also=_seen(0.95, 0.0)),
    Fact("mirror-image", REGIMES, IMAGE, 0.949475, 0.949525, "mirror image", also={SHARE: 0.95}),
    Fact("starts-disagree", REGIMES, "starts_agreeing", 42, 38, "Only 38 of 100", also={"starts": 100}),
    Fact("moved-far", REGIMES, "moved_m", 3.325, 3.675, "lies 3.7 m and 8 degrees from the rough pose"),
    Fact("turned-far", REGIMES, "turned_rad", math.radians(48), math.radians(52), "0.5 m and 52 degrees"),
    Fact("contradiction-weight", MOST, RIVAL, 0.923, 0.927, _ANOTHER, also=_seen(0.95, 0.05)),
    Fact("contradiction-weight", ("closed",), RIVAL, 0.923, 0.927, _ANOTHER, also=_seen(0.95, 0.01)),
    Fact("runner-up-margin", MOST, RIVAL, 0.921, 0.929, _ANOTHER, also=_seen(0.95, 0.05)),
    Fact("runner-up-margin", ("closed",), RIVAL, 0.921, 0.929, _ANOTHER, also=_seen(0.95, 0.01)),
    Fact("unexplained-part", ("faces",), RIVAL, 0.848, 0.852, _ANOTHER, also=_seen(0.9, 0.05)),
    Fact("unexplained-part", ("cloud",), RIVAL, 0.37, 0.38, _ANOTHER, also=_seen(0.65, 0.0)),
    Fact("unexplained-part", ("furnished",), RIVAL, 0.445, 0.455, _ANOTHER, also=_seen(0.7, 0.0)),
    Fact("unexplained-part", ("closed",), RIVAL, 0.848, 0.852, _ANOTHER, also=_seen(0.9, 0.01)),
    Fact("free-rival-margin", MOST, RIVAL, 0.747, 0.757, _ANOTHER, also=_seen(0.95, 0.001)),
    Fact("free-rival-margin", ("closed",), RIVAL, 0.745, 0.755, _ANOTHER, also=_seen(0.95, 0.0)),
    Fact("closed-rival", ("closed",), RIVAL, 0.205, 0.215, _ANOTHER, also=_seen(0.3, 0.0)),
]  # fmt: skip

NOT_ASKED = [
    ("another-place", "closed", {SHARE: 0.2}),
    ("few-walls", "closed", {"upright_surfaces": 1}),
    ("closed-directions", "faces", {"closed_directions": 0}),
    ("closed-directions", "cloud", {"closed_directions": 0}),
    ("wall-undrawn", "faces", {"undrawn_wall_share": 0.9}),
    ("wall-undrawn", "cloud", {"undrawn_wall_share": 0.9}),
    ("wall-undrawn", "closed", {"undrawn_wall_share": 0.9}),
    ("top-unexplained", "faces", {"explained_share_at_top": 0.1}),
    ("top-unexplained", "cloud", {"explained_share_at_top": 0.1}),
]
"""What is no doubt in a regime of which the row asks nothing."""

EACH = [pytest.param(fact, regime, id=f"{fact.code}-{regime}") for fact in FACTS for regime in fact.regimes]


@pytest.mark.parametrize(("fact", "regime"), EACH)
def test_a_limit_turns_the_verdict(fact: Fact, regime: str) -> None:
    clean = replace(CLEAN[regime], **fact.also)
    kept = judge(replace(clean, **{fact.member: fact.kept}))
    broken = judge(replace(clean, **{fact.member: fact.broken}))
    assert (kept.verdict, broken.verdict) == (fact.right, fact.wrong), (kept, broken)
    assert [fact.words in reason.detail for reason in broken.reasons].count(True) == 1, broken
    assert not any(fact.words in reason.detail for reason in kept.reasons), kept


@pytest.mark.parametrize(("code", "regime", "change"), NOT_ASKED)
def test_what_is_not_asked_speaks_against_nothing(code: str, regime: str, change: dict[str, Any]) -> None:
    assert judge(replace(CLEAN[regime], **change)).verdict == "accepted", code


def test_every_number_of_the_table_has_facts() -> None:
    numbers = {(row.code, regime) for row in TABLE for regime in row.limits}
    numbers |= {(factor.code, regime) for factor in FACTORS for regime in factor.values}
    assert {(fact.code, regime) for fact in FACTS for regime in fact.regimes} == numbers
    left_out = {(row.code, regime) for row in TABLE for regime in REGIMES if regime not in row.limits}
    assert {(code, regime) for code, regime, _ in NOT_ASKED} == left_out
    assert len({row.code for row in (*TABLE, *FACTORS)}) == len(TABLE) + len(FACTORS)


@pytest.mark.parametrize("fact", FACTS, ids=lambda fact: f"{fact.code}-{fact.regimes[0]}")
def test_facts_stand_close_to_each_other(fact: Fact) -> None:
    kept, broken = (float(len(v) if isinstance(v, tuple) else v) for v in (fact.kept, fact.broken))
    counts = isinstance(fact.kept, int | tuple)
    assert abs(kept - broken) <= max(0.106 * max(kept, broken), float(counts))


def test_every_row_says_where_its_numbers_come_from() -> None:
    assert all(row.trials and row.unit for row in (*TABLE, *FACTORS))
    assert all(row.sentence or row.opens for row in TABLE)


def test_an_image_seen_through_walls_is_weighed_as_in_a_closed_room() -> None:
    image = replace(CLEAN["faces"], mirrored_contradicted_share=0.002)
    assert judge(replace(image, mirrored_inlier_share=0.9685)).verdict == "accepted"
    assert judge(replace(image, mirrored_inlier_share=0.9705)).verdict == "needs-review"
