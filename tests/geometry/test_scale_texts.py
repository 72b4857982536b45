"""What dimension texts and title blocks say, and how many of them have to agree."""

from __future__ import annotations

import math
import random

import pytest

from worker.geometry.drawing.scale.decision import decide
from worker.geometry.drawing.scale.dimension_lines import Span
from worker.geometry.drawing.scale.dimension_texts import Measure, parse_measure
from worker.geometry.drawing.scale.dimension_vote import Dimension, dimension_witnesses
from worker.geometry.drawing.scale.title_block import (
    not_to_scale,
    stated_scales,
    stated_unit,
    title_witnesses,
)


@pytest.mark.parametrize(
    ("text", "value", "form"),
    [
        ("20089", 20089, "integer"),
        ("3 600", 3600, "integer"),
        ("l2O0", 1200, "integer"),
        ("3,60", 3.6, "metres"),
        ("3.605", 3.605, "metres"),
        ("4.00 m", 4.0, "stated"),
        ("450mm", 0.45, "stated"),
        ("1,200 mm", 1.2, "stated"),
        ("36 cm", 0.36, "stated"),
        ("12'-6 1/2\"", 12.5 * 0.3048 + 0.0127, "feet"),
        ("12'6", 12.5 * 0.3048, "feet"),
        ("8'-0''", 8 * 0.3048, "feet"),
        ("\N{FULLWIDTH DIGIT ONE}\N{FULLWIDTH DIGIT FIVE}\N{FULLWIDTH DIGIT ZERO}0", 1500, "integer"),
        ('36"', 36 * 0.0254, "feet"),
    ],
)
def test_a_text_that_is_a_length(text: str, value: float, form: str) -> None:
    measure = parse_measure(text)
    assert measure is not None
    assert (measure.value, measure.form) == (pytest.approx(value, abs=1e-6), form)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "5",
        "+3.20",
        "-0.15",
        "R900",
        "12.4 m2",
        "703-803",
        "A-101",
        "045",
        "1:100",
        "12'-14\"",
        "0",
        "9" * 9,
    ],
)
def test_a_text_that_is_no_length(text: str) -> None:
    assert parse_measure(text) is None


@pytest.mark.parametrize(
    ("text", "ratio", "certain"),
    [
        ("1:100", 100, False),
        ("M 1:50", 50, True),
        ('SCALE 1/4" = 1\'-0"', 48, True),
        ('1 1/2" = 1\'-0"', 8, True),
        ("1\" = 20'", 240, True),
        ("\N{CJK UNIFIED IDEOGRAPH-7E2E}\N{CJK UNIFIED IDEOGRAPH-5C3A} 1/100", 100, True),
        ("\u00c9CHELLE : 1/50", 50, True),
        ("Ma\u00dfstab 1:200", 200, True),
        ("MASSSTAB 1:20", 20, True),
        ("Escala 1:75", 75, True),
    ],
)
def test_a_stated_scale(text: str, ratio: float, certain: object) -> None:
    (stated,) = stated_scales([text])
    assert (stated.ratio, stated.certain) == (ratio, certain)


@pytest.mark.parametrize("text", ["1/4", "12/31", "1:7", "2021:100:3", '1/2"', "11:100"])
def test_no_stated_scale(text: str) -> None:
    assert stated_scales([text]) == ()


@pytest.mark.parametrize(
    "text",
    [
        "NTS",
        "N.T.S.",
        "Not to scale",
        "NOTTOSCALE",
        "unmaßstäblich",
        "UNMASSSTAEBLICH",
        "hors échelle",
        "fuori scala",
        "sin escala",
        "尺寸不准",
        "不按比例",
        "Scale: NTS",
    ],
)
def test_not_to_scale_in_many_languages(text: str) -> None:
    assert not_to_scale(["PLAN", text]) == text


@pytest.mark.parametrize("text", ["DO NOT SCALE", "NTSC", "PLANTS", "SCALE 1:100", "notes"])
def test_other_notes_are_no_veto(text: str) -> None:
    assert not_to_scale([text]) is None


def test_a_note_states_the_unit_of_bare_numbers() -> None:
    assert stated_unit(["ALL DIMENSIONS IN MM"]) == 0.001
    assert stated_unit(["Ma\u00dfe in cm"]) == 0.01
    assert stated_unit(["in mm", "in cm"]) is None
    assert stated_unit(["drawn in may"]) is None


def test_a_named_paper_size_is_a_second_witness_or_a_correction() -> None:
    a3 = (3508, 4961)  # 297 x 420 mm at 300 dpi
    same, _ = title_witnesses(["1:100 @ A3"], dpi=300.0, shape=a3)
    assert sorted(w.kind for w in same) == ["page-size", "title-block"]
    (reduced,), _ = title_witnesses(["1:100 @ A1"], dpi=300.0, shape=a3)
    assert reduced.value == pytest.approx(200 * 0.0254 / 300, rel=0.005)


def _dimension(metres: float, length: float, *, letter: float = 30.0) -> Dimension:
    measure = Measure(float(round(metres * 1000)), "integer")
    return Dimension(str(measure.value), measure, (Span(length, 0.9, (0, 0), (length, 0)),), letter)


def test_equal_lengths_repeat_each_other() -> None:
    (witness,) = dimension_witnesses([_dimension(4.0, 500.0) for _ in range(9)])
    assert witness.count == 1


def test_a_texts_own_size_tells_millimetres_from_centimetres_or_nobody_wins() -> None:
    def lengths(letter: float) -> list[Dimension]:
        return [_dimension(m, m / 0.008, letter=letter) for m in (1.2, 2.5, 4.0)]

    assert decide(dimension_witnesses(lengths(30.0))).metres_per_unit == pytest.approx(0.008, rel=1e-3)
    assert decide(dimension_witnesses(lengths(2.0))).metres_per_unit == pytest.approx(0.08, rel=1e-3)
    both = decide(dimension_witnesses(lengths(8.0)))
    assert (both.state, sorted(both.candidates)) == ("unknown", pytest.approx([0.008, 0.08], rel=1e-3))
    assert decide(dimension_witnesses(lengths(8.0), unit=0.001)).metres_per_unit == pytest.approx(
        0.008, rel=1e-3
    )


def test_a_detail_at_another_scale_is_a_second_camp() -> None:
    plan = [_dimension(m, m / 0.01) for m in (2.0, 3.1, 4.5, 7.7)]
    detail = [_dimension(m, m / 0.002) for m in (0.5, 0.9, 1.4)]
    scale = decide(dimension_witnesses([*plan, *detail]))
    assert (scale.state, scale.candidates) == ("unknown", pytest.approx((0.01, 0.002), rel=1e-3))
    many = [_dimension(m, m / 0.01) for m in (2.0, 2.5, 3.1, 3.7, 4.5, 5.5, 6.6, 7.7, 9.0)]
    assert decide(dimension_witnesses([*many, *detail])).metres_per_unit == pytest.approx(0.01, rel=1e-3)


def test_random_numbers_over_random_lines_hardly_ever_give_a_scale() -> None:
    false = 0
    for seed in range(200):
        rng = random.Random(seed)
        heard = [
            _dimension(rng.uniform(0.1, 12), rng.uniform(60, 2000))
            for _ in range(rng.choice([2, 4, 8, 16, 40]))
        ]
        false += decide(dimension_witnesses(heard, extent=3000.0)).state == "found"
    assert false <= 2


def test_true_dimensions_among_false_ones_give_the_scale_or_nothing() -> None:
    right = 0
    for seed in range(100):
        rng = random.Random(seed)
        scale = math.exp(rng.uniform(math.log(0.004), math.log(0.02)))
        true = [rng.uniform(0.8, 12) for _ in range(6)]
        heard = [_dimension(m, m / scale + rng.gauss(0, 0.5), letter=0.25 / scale) for m in true]
        heard += [
            _dimension(rng.uniform(0.1, 12), rng.uniform(60, 2000), letter=0.25 / scale)
            for _ in range(rng.choice([0, 4, 8]))
        ]
        found = decide(dimension_witnesses(heard)).metres_per_unit
        assert found is None or found == pytest.approx(scale, rel=0.005)
        right += found is not None
    assert right >= 90
