"""The scale of a vector page: at least two voices, or unknown."""

import math
from dataclasses import replace

import numpy as np
import pytest

from service.domain.scale_hint import ScaleHint
from worker.formats.linework_draft import LineworkDraft, Pen
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.page.page_scale import find_page_scale
from worker.geometry.drawing.page.spans import StrokeIndex, page_spans
from worker.geometry.drawing.scale.decision import Witness
from worker.geometry.drawing.text import Text

A3 = (0.0, 0.0, 420.0, 297.0)


def a_page(*, texts: tuple[Text, ...] = (), doors: float = 0.0, mm: float | None = 1.0) -> Linework:
    """Return an A3 page [mm] with some rooms, and four doors of a radius."""
    draft = LineworkDraft(A3, most=10_000)
    draft.add([(50, 50), (350, 50), (350, 250), (50, 250)], pen=Pen(width=0.5), closed=True)
    draft.add([(200, 50), (200, 250)], pen=Pen(width=0.5))
    for i in range(4 if doors else 0):
        draft.add_arc((60.0 + 40 * i, 60.0, doors, 0.0, math.pi / 2))
    return replace(draft.finish(page_mm_per_unit=mm), texts=texts)


def said(text: str) -> Text:
    return Text(text, 380, 20, 3.0)


def dimensioned(lengths: list[float], ratio: float, *, form: str, angle: float = 0.0) -> Linework:
    """Return a page with a chain of dimensions at 1:`ratio`, ticks and extension lines at their ends."""
    cos, sin = math.cos(angle), math.sin(angle)

    def at(t: float, o: float) -> tuple[float, float]:
        return (60 + t * cos - o * sin, 60 + t * sin + o * cos)

    draft = LineworkDraft(A3, most=10_000)
    thin, texts, start = Pen(width=0.13), [], 0.0
    draft.add([at(0, 0), at(sum(lengths), 0)], pen=thin)
    for length in [0.0, *lengths]:
        start += length
        draft.add([at(start, -4), at(start, 2)], pen=thin)
        draft.add([at(start - 1, -1), at(start + 1, 1)], pen=thin)
        if length:
            shown = form.format(length * ratio, length * ratio / 1000)
            texts.append(Text(shown, *at(start - length / 2, 2.2), 2.5, angle))
    return replace(draft.finish(page_mm_per_unit=1.0), texts=tuple(texts))


@pytest.mark.parametrize("form", ["{0:.0f}", "{1:.2f}", "{1:.3f} m"])
@pytest.mark.parametrize("angle", [0.0, math.pi / 2, 0.3])
def test_dimensions_and_their_lines_give_the_scale(form: str, angle: float) -> None:
    page = dimensioned([31.0, 42.5, 18.0, 57.0], 100.0, form=form, angle=angle)
    scale = find_page_scale(page).scale
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(0.1, rel=2e-3)


def test_a_sheet_fitted_to_other_paper_is_found_by_its_dimensions() -> None:
    page = dimensioned([31.0, 42.5, 18.0, 57.0], 141.4, form="{0:.0f}")
    scale = find_page_scale(replace(page, texts=(*page.texts, said("Scale 1:100")))).scale
    assert scale.metres_per_unit == pytest.approx(0.1414, rel=2e-3)


def test_the_number_stands_over_its_own_stretch() -> None:
    page = dimensioned([30.0, 50.0], 100.0, form="{0:.0f}")
    spans = page_spans(StrokeIndex.of(page), page.texts[1])
    assert spans[0].length == pytest.approx(50.0, abs=1e-6)
    assert spans[0].start == pytest.approx((90.0, 60.0), abs=1e-6)


def test_a_title_block_alone_finds_nothing_but_names_a_candidate() -> None:
    scale = find_page_scale(a_page(texts=(said("Scale 1:50"),))).scale
    assert scale.state == "unknown"
    assert scale.candidates[0] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("text", "metres"), [("M 1:50", 0.05), ('1/4" = 1\'-0"', 0.048), ('SCALE 1/8"=1\'-0"', 0.096)]
)
def test_a_title_block_and_doors_agree(text: str, metres: float) -> None:
    scale = find_page_scale(a_page(texts=(said(text),), doors=0.9 / metres)).scale
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(metres, rel=1e-9)


def test_a_reduced_print_is_not_believed() -> None:
    """The sheet says 1:50, but was printed at half its size: its doors are 0.45 m wide then."""
    assert find_page_scale(a_page(texts=(said("Scale 1:50"),), doors=9.0)).scale.state == "unknown"


def test_a_measure_dictionary_and_a_title_block_agree() -> None:
    measured = Witness("page-measure", 0.1, 0.1, "The page's measuring viewport says 1 cm = 1 m.")
    page = replace(a_page(texts=(said("1:100"),)), witnesses=(measured,))
    assert find_page_scale(page).scale.metres_per_unit == pytest.approx(0.1)
    other = replace(page, texts=(said("Scale 1:50"),))
    assert find_page_scale(other).scale.state == "unknown"


@pytest.mark.parametrize(("unit", "metres"), [(" m", 1.0), ("'", 0.3048)])
def test_a_scale_bar_and_a_title_block_agree(unit: str, metres: float) -> None:
    values = (0, 2, 4, 8)
    step = 1000 / 96 * metres
    row = tuple(Text(f"{v}{unit if v == 8 else ''}", 100 + v * step, 30, 2.5) for v in values)
    scale = find_page_scale(a_page(texts=(*row, said('1/8" = 1\'-0"')))).scale
    assert scale.metres_per_unit == pytest.approx(0.096)


def test_not_to_scale_is_believed() -> None:
    found = find_page_scale(a_page(texts=(said("NOT TO SCALE"), said("1:100")), doors=9.0))
    assert found.scale.state == "unknown"
    assert "not-to-scale" in [f.code for f in found.findings]


def test_a_person_may_give_the_ratio_without_dpi_and_is_told_who_disagrees() -> None:
    found = find_page_scale(a_page(texts=(said("Scale 1:50"),)), hint=ScaleHint(ratio=100.0))
    assert found.scale.state == "given"
    assert found.scale.metres_per_unit == pytest.approx(0.1)
    assert [f.code for f in found.findings] == ["scale-contradicted"]


def test_room_numbers_are_no_dimensions() -> None:
    random = np.random.default_rng(3)
    places = random.uniform((60, 60), (340, 240), size=(40, 2)).tolist()
    rooms = tuple(Text(str(100 + i), x, y, 3.0) for i, (x, y) in enumerate(places))
    assert find_page_scale(a_page(texts=rooms)).scale.state == "unknown"


def test_pixels_of_a_drawing_without_paper_are_scaled_by_dimensions() -> None:
    page = dimensioned([31.0, 42.5, 18.0, 57.0], 20.0, form="{1:.2f}")
    scale = find_page_scale(replace(page, page_mm_per_unit=None)).scale
    assert scale.metres_per_unit == pytest.approx(0.02, rel=1e-2)
