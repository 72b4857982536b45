"""The scale of a sheet, read from its dimension texts, title block and scale bar, or honestly unknown."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from service.domain.scale_hint import ScaleHint
from tests.drawn_sheets import DrawnSheet
from worker.formats.ocr import load_recogniser
from worker.formats.raster import load_sheet
from worker.geometry.drawing.raster.sheet import Sheet
from worker.geometry.drawing.raster.sheet_scale import Recognise, find_sheet_scale
from worker.geometry.drawing.scale.sheet_scale import SheetScale

pytest.importorskip("onnxruntime", reason="text recognition is the extra ocr")
pytest.importorskip("rapidocr", reason="text recognition is the extra ocr")


@pytest.fixture(scope="module")
def recognise() -> Recognise:
    reader = load_recogniser()
    assert reader is not None
    return reader


def plan(texts: tuple[str, str, str], **how: bool) -> DrawnSheet:
    """Return a room of 1200 x 800 px with a wall at 500 px, and three dimensions: 500, 700 and 800 px."""
    sheet = DrawnSheet()
    sheet.walls([(400, 300), (1600, 300), (1600, 1100), (400, 1100)])
    sheet.line((900, 300), (900, 1100), width=14)
    sheet.dimension((400, 300), (900, 300), texts[0], **how)
    sheet.dimension((900, 300), (1600, 300), texts[1], **how)
    sheet.dimension((400, 1100), (400, 300), texts[2], **how)
    sheet.write("OFFICE 204", (650, 700))
    return sheet


def found(sheet: DrawnSheet, recognise: Recognise, **stated: float) -> SheetScale:
    return find_sheet_scale(Sheet(sheet.grey, **stated), recognise=recognise)


@pytest.mark.parametrize("arrows", [False, True])
@pytest.mark.parametrize(
    ("texts", "metres_per_px"),
    [
        (("4000", "5600", "6400"), 0.008),
        (("400", "560", "640"), 0.008),
        (("4.00", "5.60", "6.40"), 0.008),
        (("4,00", "5,60", "6,40"), 0.008),
        (("4.00 m", "5.60 m", "6.40 m"), 0.008),
        (("12'-6\"", "17'-6\"", "20'-0\""), 12.5 * 0.3048 / 500),
    ],
)
def test_dimensions_in_any_unit_give_the_scale(
    recognise: Recognise, texts: tuple[str, str, str], metres_per_px: float, *, arrows: bool
) -> None:
    scale = found(plan(texts, arrows=arrows), recognise).scale
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(metres_per_px, rel=0.005)
    assert [(w.kind, w.count) for w in scale.witnesses] == [("dimension-text", 3)]


def test_slanted_dimensions_are_read(recognise: Recognise) -> None:
    sheet = DrawnSheet()
    corners = [(500.0, 300.0), (1500.0, 420.0), (1460.0, 1100.0), (380.0, 980.0)]
    sheet.walls(corners)
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        sheet.dimension(a, b, str(round(float(np.hypot(b[0] - a[0], b[1] - a[1])) * 9)))
    scale = found(sheet, recognise).scale
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(0.009, rel=0.005)


def test_dimensions_that_contradict_each_other_leave_the_scale_unknown(recognise: Recognise) -> None:
    result = found(plan(("4000", "7300", "2100")), recognise)
    assert (result.scale.state, result.scale.metres_per_unit) == ("unknown", None)
    assert result.scale.candidates


def test_equal_rooms_with_numbers_give_no_scale(recognise: Recognise) -> None:
    sheet = DrawnSheet(letters=26)
    for column in range(4):
        for row in range(3):
            x, y = 200 + column * 400, 200 + row * 300
            sheet.walls([(x, y), (x + 400, y), (x + 400, y + 300), (x, y + 300)], width=4)
            sheet.write(str(101 + 4 * row + column), (x + 200, y + 30))
    assert found(sheet, recognise).scale.state == "unknown"


def test_a_sheet_that_calls_itself_not_to_scale_is_believed(recognise: Recognise) -> None:
    sheet = plan(("4000", "5600", "6400"))
    sheet.write("NOT TO SCALE", (1500, 1300))
    result = found(sheet, recognise)
    assert result.scale.state == "unknown"
    assert result.scale.candidates[0] == pytest.approx(0.008, rel=0.005)
    assert "not-to-scale" in [f.code for f in result.findings]


def test_a_title_block_alone_is_one_witness(recognise: Recognise) -> None:
    sheet = plan(("", "", ""))
    sheet.write("SCALE 1:100", (1500, 1300))
    scale = found(sheet, recognise, dpi=300.0).scale
    assert (scale.state, [w.kind for w in scale.witnesses]) == ("unknown", ["title-block"])
    assert scale.candidates == (pytest.approx(100 * 0.0254 / 300),)


@pytest.mark.parametrize("dpi", [72.0, 96.0])
def test_the_default_dpi_of_a_program_is_not_believed(recognise: Recognise, dpi: float) -> None:
    sheet = plan(("", "", ""))
    sheet.write("SCALE 1:100", (1500, 1300))
    result = found(sheet, recognise, dpi=dpi)
    assert (result.scale.state, result.scale.candidates) == ("unknown", ())
    assert [f.code for f in result.findings] == ["scale-needs-dpi"]


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("ft", 0.3048)])
def test_a_title_block_and_a_scale_bar_agree(recognise: Recognise, unit: str, metres: float) -> None:
    sheet = plan(("", "", ""))
    sheet.write("SCALE 1:100", (1500, 1300))
    per_px = 100 * 0.0254 / 300
    step = 1 if unit == "m" else 4
    sheet.scale_bar(
        (200, 1300), px_per_unit=metres / per_px, numbers=[0, step, 2 * step, 5 * step], unit=unit
    )
    scale = found(sheet, recognise, dpi=300.0).scale
    assert sorted(w.kind for w in scale.witnesses) == ["scale-bar", "title-block"]
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(per_px, rel=0.005)


def test_a_title_block_that_disagrees_with_three_dimensions_is_named(recognise: Recognise) -> None:
    sheet = plan(("4000", "5600", "6400"))
    sheet.write("SCALE 1:50", (1500, 1300))
    result = found(sheet, recognise, dpi=300.0)
    assert result.scale.metres_per_unit == pytest.approx(0.008, rel=0.005)
    assert [f.code for f in result.findings] == ["scale-contradicted"]


def test_a_person_wins_over_the_sheet(recognise: Recognise) -> None:
    result = find_sheet_scale(
        Sheet(plan(("4000", "5600", "6400")).grey),
        recognise=recognise,
        hint=ScaleHint(metres_per_unit=0.016),
    )
    assert (result.scale.state, result.scale.metres_per_unit) == ("given", 0.016)
    assert [f.code for f in result.findings] == ["scale-contradicted"]


def test_the_texts_come_with_their_places(recognise: Recognise) -> None:
    texts = {t.text: t for t in found(plan(("4000", "5600", "6400")), recognise).texts}
    room = texts["OFFICE 204"]
    assert (room.x, room.y, room.angle) == (pytest.approx(650, abs=3), pytest.approx(700, abs=3), 0.0)
    assert texts["6400"].angle == pytest.approx(np.pi / 2, abs=0.05)


def test_without_text_recognition_a_finding_says_so() -> None:
    result = find_sheet_scale(Sheet(plan(("4000", "5600", "6400")).grey), recognise=None)
    assert result.scale.state == "unknown"
    assert [f.code for f in result.findings] == ["ocr-not-installed"]


@pytest.mark.parametrize("package", ["onnxruntime", "rapidocr"])
def test_no_recogniser_without_the_extra(monkeypatch: pytest.MonkeyPatch, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    assert load_recogniser() is None


def test_reading_can_be_cancelled(recognise: Recognise) -> None:
    def cancel(_stage: str, share: float) -> None:
        if share > 0:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        find_sheet_scale(Sheet(plan(("4000", "5600", "6400")).grey), recognise=recognise, progress=cancel)


@pytest.mark.parametrize("shape", [(1, 1), (3, 900), (200, 200)])
def test_a_blank_or_tiny_sheet_has_no_scale(recognise: Recognise, shape: tuple[int, int]) -> None:
    for colour in (0, 255):
        sheet = Sheet(np.full(shape, colour, dtype=np.uint8))
        assert find_sheet_scale(sheet, recognise=recognise).scale.state == "unknown"


def test_a_large_sheet_is_looked_at_in_coarser_pixels(recognise: Recognise) -> None:
    small = plan(("4000", "5600", "6400")).grey
    large = np.kron(small, np.ones((3, 3), dtype=np.uint8))
    scale = find_sheet_scale(Sheet(large), recognise=recognise).scale
    assert scale.metres_per_unit == pytest.approx(0.008 / 3, rel=0.005)


@pytest.mark.parametrize("name", ["rmf_office", "cad_Aule-scolastiche-pianta-1"])
def test_the_dimensions_of_real_plans(recognise: Recognise, shared_data: Path, name: str) -> None:
    truth = json.loads((shared_data / "drawings" / f"{name}.truth.json").read_text())
    grey = load_sheet(shared_data / "drawings" / f"{name}.png").grey
    scale = find_sheet_scale(Sheet(grey), recognise=recognise).scale
    assert scale.state == "found"
    assert scale.metres_per_unit == pytest.approx(truth["metres_per_px"], rel=0.005)


@pytest.mark.parametrize(
    "name", ["mls_748", "cad_Scuola-pianta-03", "rmf_hotel_L1", "rmf_triple_H", "rmf_office_scan"]
)
def test_real_plans_without_dimensions_stay_unknown(
    recognise: Recognise, shared_data: Path, name: str
) -> None:
    grey = load_sheet(shared_data / "drawings" / f"{name}.png").grey
    assert find_sheet_scale(Sheet(grey), recognise=recognise).scale.state == "unknown"
