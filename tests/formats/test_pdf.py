"""PDF pages: what is drawn on them, how they are displayed, and the hostile ones."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pypdf import PdfReader, PdfWriter

from service.domain.bounds import Bounds
from service.domain.errors import (
    DrawingTooComplex,
    FileEmpty,
    FileEncrypted,
    FileMalformed,
    FileTruncated,
    PageNeeded,
    PageNotFound,
)
from tests.formats.pdf_writer import one_page, pdf_bytes, stream
from worker.formats.pdf import load_pdf
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.raster.sheet import Sheet

PT = 25.4 / 72
LINE = b"10 20 m 110 20 l S"


def drawn(
    tmp_path: Path, document: bytes, *, page: int | None = None, bounds: Bounds | None = None
) -> Linework:
    path = tmp_path / "sheet.pdf"
    path.write_bytes(document)
    found = load_pdf(path, page=page, bounds=bounds)
    assert isinstance(found, Linework)
    return found


def points(*pairs: tuple[float, float]) -> NDArray[np.float64]:
    return np.array(pairs, dtype=np.float64) * PT


def test_a_line_has_its_place_pen_and_paper(tmp_path: Path) -> None:
    page = drawn(tmp_path, one_page(b"1 0 0 RG 2 w " + LINE + b" [3 2] 0 d 0.5 w 0 0 m 0 50 l S"))
    assert page.page_mm_per_unit == 1.0
    assert page.sheet == pytest.approx((0, 0, 400 * PT, 200 * PT))
    assert np.allclose(page.ends[0], points((10, 20), (110, 20)), atol=1e-4)
    assert page.width == pytest.approx([2 * PT, 0.5 * PT], abs=1e-4)
    assert page.colour.tolist() == [0xFF0000, 0xFF0000]
    assert page.dashed.tolist() == [False, True]
    assert page.kind.tolist() == ["line", "line"]


@pytest.mark.parametrize(
    ("turn", "start", "end", "size"),
    [
        (0, (10, 20), (110, 20), (400, 200)),
        (90, (20, 390), (20, 290), (200, 400)),
        (180, (390, 180), (290, 180), (400, 200)),
        (270, (180, 10), (180, 110), (200, 400)),
    ],
)
def test_a_page_is_read_as_it_is_displayed(
    tmp_path: Path, turn: int, start: tuple[int, int], end: tuple[int, int], size: tuple[int, int]
) -> None:
    page = drawn(tmp_path, one_page(LINE, page=b"/MediaBox[0 0 400 200]/Rotate %d" % turn))
    assert np.allclose(page.ends[0], points(start, end), atol=1e-4)
    assert page.sheet == pytest.approx((0, 0, size[0] * PT, size[1] * PT))


def test_crop_box_and_user_unit_are_applied(tmp_path: Path) -> None:
    box = b"/MediaBox[0 0 400 200]/CropBox[5 10 105 60]/UserUnit 2"
    page = drawn(tmp_path, one_page(LINE + b" 0 0 m 400 5 l S", page=box))
    assert page.sheet == pytest.approx((0, 0, 200 * PT, 100 * PT))
    assert np.allclose(page.ends, [points((10, 20), (200, 20))], atol=1e-3), "cut at the crop box"


def test_forms_are_drawn_through_their_matrices_and_windows(tmp_path: Path) -> None:
    outer = stream(
        b"q 3 0 0 3 0 0 cm /B Do Q q 0 0 8 8 re W n 0 5 m 10 5 l S Q",
        b"/Subtype/Form/BBox[0 0 50 50]/Matrix[1 0 0 1 1 1]/Resources<</XObject<</B 7 0 R>>>>",
    )
    inner = stream(b"0 0 m 1 1 l S", b"/Subtype/Form/BBox[0 0 9 9]")
    page = drawn(
        tmp_path,
        one_page(b"q 2 0 0 2 10 20 cm /A Do Q", resources=b"/XObject<</A 6 0 R>>", more=[outer, inner]),
    )
    assert np.allclose(page.ends[0], points((12, 22), (18, 28)), atol=1e-3)
    assert np.allclose(page.ends[1], points((12, 32), (28, 32)), atol=1e-3), "cut at the form's own window"


def test_lines_that_go_on_are_one_entity_and_a_chain_of_chords_an_arc(tmp_path: Path) -> None:
    angle = np.radians(np.linspace(0, 90, 16))
    chain = np.column_stack([100 + 40 * np.cos(angle), 50 + 40 * np.sin(angle)])
    steps = itertools.pairwise(chain)
    content = b" ".join(b"%.4f %.4f m %.4f %.4f l S" % (*a, *b) for a, b in steps)
    page = drawn(tmp_path, one_page(content + b" 0 0 m 5 5 l S"))
    assert page.kind.tolist() == ["polyline", "line"]
    assert page.arcs is not None
    assert page.arcs[0] == pytest.approx([100 * PT, 50 * PT, 40 * PT, 0, math.pi / 2], abs=2e-3)


def test_a_circle_of_four_curves_is_one_arc_and_fine_enough(tmp_path: Path) -> None:
    r, k = 40.0, 40.0 * 0.5522847498
    corners = [(r, k, k, r, 0, r), (-k, r, -r, k, -r, 0), (-r, -k, -k, -r, 0, -r), (k, -r, r, -k, r, 0)]
    circle = b"%f 0 m " % r + b" ".join(b"%f %f %f %f %f %f c" % c for c in corners) + b" h S"
    page = drawn(tmp_path, one_page(b"1 0 0 1 100 100 cm " + circle))
    assert page.kind.tolist() == ["circle"]
    assert page.arcs is not None
    assert len(page.arcs) == 1
    assert abs(page.arcs[0, 4]) == pytest.approx(2 * math.pi, abs=3e-3)
    middle = page.ends.mean(axis=1) - np.array([100, 100]) * PT
    assert np.abs(np.hypot(*middle.T) - r * PT).max() < 0.06


def test_fills_are_closed_and_white_ones_are_masks(tmp_path: Path) -> None:
    page = drawn(tmp_path, one_page(b"0.6 g 10 10 40 20 re f 1 g 0 0 9 9 re f 1 G 0 0 m 50 50 l S"))
    assert page.kind.tolist() == ["solid", "mask"]
    assert (page.filled.tolist(), page.closed.tolist()) == ([True, True], [True, True])
    assert page.colour.tolist() == [0x999999, 0xFFFFFF]
    assert len(page.ends) == 8


def test_an_area_with_a_hole_is_one_entity_of_two_rings(tmp_path: Path) -> None:
    page = drawn(tmp_path, one_page(b"0.5 g 10 10 80 60 re 20 20 60 40 re f*"))
    assert page.entity.tolist() == [0] * 8
    assert page.kind.tolist() == ["solid"]


def test_layers_have_their_names_and_hidden_ones_are_passed_over(tmp_path: Path) -> None:
    content = (
        b"/OC /W BDC " + LINE + b" EMC /OC /H BDC 0 0 m 9 9 l S BT /F 9 Tf (gone) Tj ET EMC 5 5 m 6 6 l S"
    )
    page = drawn(
        tmp_path,
        one_page(
            content,
            resources=b"/Properties<</W 6 0 R/H 7 0 R>>",
            catalogue=b"/OCProperties<</OCGs[6 0 R 7 0 R]/D<</OFF[7 0 R]>>>>",
            more=[b"<</Type/OCG/Name(A-WALL)>>", b"<</Type/OCG/Name(Survey)>>"],
        ),
    )
    assert [page.layer_names[i] for i in page.layer] == ["A-WALL", ""]
    assert page.texts == ()
    (finding,) = page.findings
    assert (finding.code, finding.values) == ("layer-hidden", {"layer": "Survey", "objects": 2})


def test_texts_have_place_height_angle_and_are_joined(tmp_path: Path) -> None:
    content = (
        b"BT /F 10 Tf 1 0 0 1 50 60 Tm (Sca) Tj (le 1:) Tj (100) Tj ET "
        b"BT /F 10 Tf 0 1 -1 0 300 40 Tm (4500) Tj ET " + LINE
    )
    along, up = drawn(tmp_path, one_page(content)).texts
    assert (along.text, up.text) == ("Scale 1:100", "4500")
    assert along.height == pytest.approx(7.2 * PT, rel=0.02)
    assert along.y == pytest.approx((60 + 3.6) * PT, abs=0.1)
    assert along.x == pytest.approx((50 + 25.8) * PT, abs=1.0)
    assert up.angle == pytest.approx(math.pi / 2)
    assert (up.x, up.y) == pytest.approx(((300 - 3.6) * PT, (40 + 11.1) * PT), abs=0.6)


def test_autocad_stroke_letters_are_read_from_their_annotations(tmp_path: Path) -> None:
    note = b"<</Type/Annot/Subtype/Square/Rect[50 60 90 68]/T(AutoCAD SHX Text)/Contents(SCALE 1:50)>>"
    other = b"<</Type/Annot/Subtype/Square/Rect[0 0 9 9]/T(Somebody)/Contents(Why here?)>>"
    page = b"/MediaBox[0 0 400 200]/Annots[6 0 R 7 0 R]"
    (text,) = drawn(tmp_path, one_page(LINE, page=page, more=[note, other])).texts
    assert text.text == "SCALE 1:50"
    assert (text.x, text.y, text.height) == pytest.approx((70 * PT, 64 * PT, 8 * PT), abs=1e-3)


@pytest.mark.parametrize(
    ("axis", "metres"),
    [
        (b"<</U(ft)/C .1111111/D 1>>", 0.1111111 * 0.3048),
        (b"<</U(m)/C .0352778>>", 0.0352778),
        (b"<</U(mm)/C 35.2778>>", 0.0352778),
    ],
)
def test_a_measuring_viewport_is_a_witness(tmp_path: Path, axis: bytes, metres: float) -> None:
    measure = b"<</Type/Measure/Subtype/RL/R(as drawn)/X[%s]/D[%s]>>" % (axis, axis)
    viewport = b"/VP[<</Type/Viewport/BBox[0 0 400 200]/Measure %s>>]" % measure
    (witness,) = drawn(tmp_path, one_page(LINE, page=b"/MediaBox[0 0 400 200]" + viewport)).witnesses
    assert witness.kind == "page-measure"
    assert witness.value == pytest.approx(metres / PT, rel=1e-6)
    assert "as drawn" in witness.detail


def scan(pixels: NDArray[np.uint8], *, turn: int = 0, letters: bytes = b"") -> bytes:
    high, wide = pixels.shape
    head = b"/Subtype/Image/Width %d/Height %d/BitsPerComponent 8/ColorSpace/DeviceGray" % (wide, high)
    return one_page(
        b"q 400 0 0 200 0 0 cm /I Do Q " + letters,
        page=b"/MediaBox[0 0 400 200]/Rotate %d" % turn,
        resources=b"/XObject<</I 6 0 R>>",
        more=[stream(pixels.tobytes(), head, pack=True)],
    )


@pytest.mark.parametrize("turn", [0, 90])
def test_a_scanned_page_is_its_image_pixel_by_pixel(tmp_path: Path, turn: int) -> None:
    pixels = np.full((300, 600), 255, dtype=np.uint8)
    pixels[40:60, 100:500] = 20
    path = tmp_path / "scan.pdf"
    path.write_bytes(scan(pixels, turn=turn, letters=b"BT 3 Tr /F 10 Tf 1 0 0 1 40 20 Tm (1:50) Tj ET"))
    sheet = load_pdf(path)
    assert isinstance(sheet, Sheet)
    assert np.abs(sheet.grey.astype(int) - np.rot90(pixels, -turn // 90).astype(int)).max() <= 2
    assert sheet.dpi == pytest.approx(108.0, rel=1e-3)
    (text,) = sheet.texts
    assert text.text == "1:50"
    if not turn:
        assert (text.x, text.y) == pytest.approx((60 + 14, 300 - 30 - 5.4), abs=3)


def test_a_scan_over_the_limit_is_read_coarser_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "scan.pdf"
    path.write_bytes(scan(np.zeros((400, 800), dtype=np.uint8)))
    sheet = load_pdf(path, bounds=Bounds(max_pixels=20_000))
    assert isinstance(sheet, Sheet)
    assert sheet.grey.size <= 20_400
    assert [f.code for f in sheet.findings] == ["page-coarsened"]


def test_several_pages_and_none_chosen_lists_them(tmp_path: Path) -> None:
    pages = [b"<</Type/Page/Parent 2 0 R/MediaBox[0 0 %d 720]>>" % (360 * i) for i in (1, 2)]
    kids = b"<</Type/Pages/Kids[3 0 R 4 0 R]/Count 2>>"
    document = pdf_bytes([b"<</Type/Catalog/Pages 2 0 R>>", kids, *pages])
    with pytest.raises(PageNeeded) as refusal:
        drawn(tmp_path, document)
    assert refusal.value.members["page_count"] == 2
    assert refusal.value.members["pages"][1] == {"page": 2, "width_mm": 254.0, "height_mm": 254.0}
    assert drawn(tmp_path, document, page=2).sheet == pytest.approx((0, 0, 254, 254), abs=0.1)
    with pytest.raises(PageNotFound):
        drawn(tmp_path, document, page=3)


def test_a_hundred_thousand_pages_are_listed_in_part_and_one_is_read(tmp_path: Path) -> None:
    count = 100_000
    kids = b" ".join(b"%d 0 R" % (4 + i) for i in range(count))
    page = b"<</Type/Page/Parent 2 0 R/MediaBox[0 0 400 200]/Contents 3 0 R>>"
    pages = b"<</Type/Pages/Kids[%s]/Count %d>>" % (kids, count)
    document = pdf_bytes([b"<</Type/Catalog/Pages 2 0 R>>", pages, stream(LINE), *[page] * count])
    with pytest.raises(PageNeeded) as refusal:
        drawn(tmp_path, document)
    assert refusal.value.members["page_count"] == count
    assert len(refusal.value.members["pages"]) == 50
    assert len(drawn(tmp_path, document, page=count).ends) == 1


def encrypted(document: bytes, tmp_path: Path, *, user: str) -> bytes:
    plain, locked = tmp_path / "plain.pdf", tmp_path / "locked.pdf"
    plain.write_bytes(document)
    with PdfReader(plain) as reader, PdfWriter() as writer:
        writer.append(reader)
        writer.encrypt(user, "owner", algorithm="RC4-128")
        writer.write(locked)
    return locked.read_bytes()


def test_an_encrypted_document_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(FileEncrypted, match="without one"):
        drawn(tmp_path, encrypted(one_page(LINE), tmp_path, user="secret"))


def test_a_document_that_only_forbids_copying_is_read(tmp_path: Path) -> None:
    box = b"/MediaBox[0 0 400 200]/UserUnit 2"
    page = drawn(tmp_path, encrypted(one_page(LINE, page=box), tmp_path, user=""))
    assert np.allclose(page.ends[0], 2 * points((10, 20), (110, 20)), atol=1e-3)


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    whole = one_page(LINE)
    for size in range(0, len(whole) - 7, 37):
        with pytest.raises((FileEmpty, FileTruncated, FileMalformed)):
            drawn(tmp_path, whole[:size])
    with pytest.raises(FileTruncated, match="cut short"):
        drawn(tmp_path, whole[: len(whole) // 2])


def test_any_damaged_byte_reads_or_is_refused(tmp_path: Path) -> None:
    whole = one_page(LINE + b" BT /F 9 Tf (1:50) Tj ET")
    random = np.random.default_rng(5)
    for _ in range(150):
        broken = bytearray(whole)
        for at in random.integers(0, len(whole) - 8, size=3):
            broken[at] = random.integers(256)
        try:
            drawn(tmp_path, bytes(broken))
        except (FileMalformed, FileTruncated, FileEmpty, FileEncrypted, DrawingTooComplex, PageNotFound):
            continue


def test_forms_that_call_forms_without_end_are_refused(tmp_path: Path) -> None:
    forms = [
        stream(
            b"/X Do " * 12,
            b"/Subtype/Form/BBox[0 0 9 9]/Resources<</XObject<</X %d 0 R>>>>" % (7 + i),
        )
        for i in range(12)
    ]
    bomb = one_page(
        b"/X Do",
        resources=b"/XObject<</X 6 0 R>>",
        more=[*forms, stream(LINE, b"/Subtype/Form/BBox[0 0 9 9]")],
    )
    with pytest.raises(DrawingTooComplex):
        drawn(tmp_path, bomb)


def test_a_form_that_calls_itself_ends(tmp_path: Path) -> None:
    own = stream(LINE + b" /X Do", b"/Subtype/Form/BBox[0 0 200 200]/Resources<</XObject<</X 6 0 R>>>>")
    assert len(drawn(tmp_path, one_page(b"/X Do", resources=b"/XObject<</X 6 0 R>>", more=[own])).ends) >= 1


def test_a_stream_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DrawingTooComplex, match="unpacks"):
        drawn(tmp_path, one_page(b" " * (200 << 20), pack=True))


def test_too_many_strokes_are_refused(tmp_path: Path) -> None:
    content = b"0 0 m " + b"5 5 l 0 5 l " * 2000 + b"S"
    with pytest.raises(DrawingTooComplex, match="strokes"):
        drawn(tmp_path, one_page(content), bounds=Bounds(max_strokes=1000))


@pytest.mark.parametrize("box", [b"[0 0 1000000000 1000000000]", b"[0 0 10000000 100]"])
def test_a_page_of_kilometres_is_refused(tmp_path: Path, box: bytes) -> None:
    with pytest.raises(FileMalformed, match="of paper"):
        drawn(tmp_path, one_page(LINE, page=b"/MediaBox" + box))


def test_numbers_that_are_none_leave_the_rest_readable(tmp_path: Path) -> None:
    page = drawn(tmp_path, one_page(b"nan nan m 1e400 5 l S 1e30 0 m 1e30 1 l S " + LINE))
    assert np.isfinite(page.ends).all()
    assert np.allclose(page.ends[-1], points((10, 20), (110, 20)), atol=1e-3)


def test_the_real_pages(shared_data: Path) -> None:
    scanned = load_pdf(shared_data / "drawings" / "pdf_scanned-plan.pdf")
    assert isinstance(scanned, Sheet)
    assert scanned.grey.shape == (1584, 2448)
    assert scanned.dpi == pytest.approx(144.0)
    plan = load_pdf(shared_data / "drawings" / "pdf_sample-finish-plan.pdf", page=1)
    assert isinstance(plan, Linework)
    assert plan.sheet == pytest.approx((0, 0, 1066.8, 762.0), abs=0.1)
    assert any('1/8" = 1\'-0"' in t.text for t in plan.texts)
