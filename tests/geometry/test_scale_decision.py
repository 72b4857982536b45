"""The scale is a hypothesis: who is heard, who wins, and when nobody does."""

from __future__ import annotations

import math

import pytest
from hypothesis import given as over
from hypothesis import strategies as st

from service.domain.scale_hint import KnownLength, ScaleHint
from worker.geometry.drawing.scale.decision import USUAL_UNITS, Witness, contradictions, decide

UNITS = tuple(USUAL_UNITS.values())


def exact(kind: str, value: float, count: int = 1) -> Witness:
    return Witness(kind, value, value, f"{kind} says {value:g}.", count)


def building(unit: float, *, claim: float | None, doors: bool = True) -> list[Witness]:
    """Return what a 40 m building with 0.9 m doors and 0.2 m walls tells, drawn in a unit."""
    out = [
        Witness("extent", 8 * unit / 40, 400 * unit / 40, "extent"),
        Witness("wall-spacing", 0.08 * unit / 0.2, 0.4 * unit / 0.2, "walls", 30),
    ]
    if doors:
        out.append(Witness("door-arcs", 0.6 * unit / 0.9, 1.2 * unit / 0.9, "doors", 12))
    return out + ([] if claim is None else [exact("file-unit", claim)])


@pytest.mark.parametrize("unit", UNITS)
def test_a_building_tells_its_unit_without_a_header(unit: float) -> None:
    scale = decide(building(unit, claim=None), units=UNITS)
    assert (scale.state, scale.metres_per_unit) == ("found", unit)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("claim", UNITS)
def test_a_wrong_header_never_gives_a_wrong_unit(unit: float, claim: float) -> None:
    scale = decide(building(unit, claim=claim), units=UNITS)
    assert scale.metres_per_unit in {unit, None}
    assert scale.metres_per_unit == unit or 0.3 < claim / unit < 4
    assert unit in scale.candidates
    if scale.state == "found" and claim != unit:
        assert [f.values["witness"] for f in contradictions(scale)] == ["file-unit"]


def test_metres_called_millimetres_are_metres() -> None:
    assert decide(building(1.0, claim=0.001), units=UNITS).metres_per_unit == 1.0


def test_one_witness_is_not_enough() -> None:
    scale = decide([exact("title-block", 0.01)])
    assert (scale.state, scale.metres_per_unit, scale.candidates) == ("unknown", None, (0.01,))


def test_a_range_does_not_name_a_continuous_scale() -> None:
    assert decide([exact("title-block", 0.01), Witness("door-arcs", 0.008, 0.016, "d")]).state == "unknown"


def test_title_block_and_one_dimension_agree() -> None:
    scale = decide([exact("title-block", 0.01), exact("dimension-text", 0.0101)])
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(0.01005, rel=1e-3)


def test_the_same_statement_twice_is_one_voice() -> None:
    assert decide([exact("title-block", 0.01), exact("title-block", 0.01)]).state == "unknown"


def test_two_dimensions_are_two_voices_and_their_median_counts() -> None:
    scale = decide([exact("dimension-text", v) for v in (0.01, 0.01001, 0.01, 0.0237, 0.1)])
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(0.01)


def test_two_camps_are_unknown_and_both_are_named() -> None:
    scale = decide([exact("dimension-text", 0.01, 3), exact("dimension-text", 0.02, 2)])
    assert (scale.state, scale.candidates) == ("unknown", (0.01, 0.02))
    assert [f.code for f in contradictions(scale)] == ["scale-witnesses-disagree"]


def test_ranges_that_agree_on_another_scale_stand_against() -> None:
    against = [Witness("door-arcs", 0.02, 0.04, "d"), Witness("wall-spacing", 0.015, 0.08, "w")]
    assert decide([exact("dimension-text", 0.01, 3)]).state == "found"
    assert decide([exact("dimension-text", 0.01, 3), *against]).state == "unknown"


def test_not_to_scale_is_believed() -> None:
    scale = decide([exact("dimension-text", 0.01, 3)], vetoed=True)
    assert (scale.state, scale.candidates) == ("unknown", (0.01,))


def test_a_person_wins_and_hears_the_contradiction() -> None:
    sheet = [exact("dimension-text", 0.01, 3)]
    scale = decide(sheet, hint=ScaleHint(metres_per_unit=0.02), vetoed=True)
    assert (scale.state, scale.metres_per_unit) == ("given", 0.02)
    assert [(f.code, f.severity) for f in contradictions(scale)] == [("scale-contradicted", "warning")]
    assert contradictions(decide(sheet, hint=ScaleHint(metres_per_unit=0.0101))) == ()


def test_several_measured_lengths_are_fitted_and_their_spread_is_said() -> None:
    true = (KnownLength(0, 0, 300, 400, 5.0), KnownLength(0, 0, 1000, 0, 10.1))
    scale = decide([], hint=ScaleHint(known_lengths=true))
    assert scale.metres_per_unit == pytest.approx((5.0 * 500 + 10.1 * 1000) / (500**2 + 1000**2))
    assert [w.kind for w in scale.witnesses] == ["given-length", "given-length"]
    assert contradictions(scale) == ()
    wrong = (*true, KnownLength(0, 0, 0, 100, 1.1))
    assert [f.code for f in contradictions(decide([], hint=ScaleHint(known_lengths=wrong)))] == [
        "given-lengths-disagree"
    ]


def test_a_thousand_dimensions_are_heard_by_an_even_selection() -> None:
    scale = decide([exact("dimension-text", 0.01 * 1.00001**k) for k in range(1000)])
    assert scale.state == "found"
    assert len(scale.witnesses) == 200
    assert scale.metres_per_unit == pytest.approx(0.01 * 1.00001**500, rel=1e-4)


@over(
    st.lists(st.tuples(st.sampled_from([0.01, 0.013, 0.02]), st.integers(1, 3)), max_size=6),
    st.floats(1e-4, 1e4),
)
def test_another_unit_of_length_changes_nothing(said: list[tuple[float, int]], factor: float) -> None:
    one = decide([exact("dimension-text", v, n) for v, n in said])
    other = decide([exact("dimension-text", v * factor, n) for v, n in said])
    assert one.state == other.state
    assert [c * factor for c in one.candidates] == pytest.approx(list(other.candidates))
    assert (one.metres_per_unit or math.nan) * factor == pytest.approx(
        other.metres_per_unit or math.nan, nan_ok=True
    )


def test_a_length_written_into_the_file_decides_alone() -> None:
    against = [exact("dimension-text", 0.02, 50), exact("title-block", 0.02), Witness("extent", 1.0, 2.0, "")]
    scale = decide([exact("measured-length", 0.01), *against])
    assert (scale.state, scale.metres_per_unit, scale.candidates) == ("found", 0.01, (0.01,))
    assert len(contradictions(scale)) == len(against)
    assert decide([exact("measured-length", 0.01)]).state == "found"
    assert decide([exact("measured-length", 0.01)], vetoed=True).state == "unknown"


def test_of_two_such_lengths_the_rest_decides() -> None:
    two = [exact("measured-length", 0.01), exact("measured-length", 0.03)]
    assert decide(two).state == "unknown"
    assert set(decide(two).candidates) == {0.01, 0.03}
    assert decide([*two, exact("title-block", 0.03)]).metres_per_unit == 0.03
    assert decide([*two, exact("title-block", 0.02)]).state == "unknown"
    assert decide([*two, exact("measured-length", 0.0302)]).metres_per_unit == pytest.approx(0.0301, abs=1e-4)
