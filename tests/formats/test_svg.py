"""SVG drawings: units, transforms, layers, pens and texts, and the hostile ones."""

import math
from pathlib import Path

import numpy as np
import pytest

from service.domain.bounds import Bounds
from service.domain.errors import DomainError, DrawingTooComplex, FileEmpty, FileMalformed, FileTruncated
from worker.formats.svg import load_svg
from worker.geometry.drawing.linework.linework import Linework

PLAIN = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
SHEET = 'width="200mm" height="100mm" viewBox="0 0 2000 1000"'
LINE = '<line x1="100" y1="900" x2="600" y2="900" stroke="black"/>'


def drawn(
    tmp_path: Path, body: str, *, sheet: str = SHEET, head: str = "", bounds: Bounds | None = None
) -> Linework:
    path = tmp_path / "plan.svg"
    path.write_text(f"<?xml version='1.0'?>{head}<svg {PLAIN} {sheet}>{body}</svg>", encoding="utf-8")
    return load_svg(path, bounds=bounds)


@pytest.mark.parametrize(
    ("sheet", "scale", "height", "mm"),
    [
        (SHEET, 0.1, 100.0, 1.0),
        ('width="20cm" height="10cm" viewBox="0 0 2000 1000"', 0.1, 100.0, 1.0),
        ('width="10in" height="5in" viewBox="0 0 2000 1000"', 0.127, 127.0, 1.0),
        ('width="1000" height="500" viewBox="0 0 2000 1000"', 0.5, 500.0, None),
        ('viewBox="0 0 2000 1000"', 1.0, 1000.0, None),
        ('width="100%" height="100%" viewBox="0 0 2000 1000"', 1.0, 1000.0, None),
        ('width="2000" height="1000"', 1.0, 1000.0, None),
        ('width="500mm" height="264.583333mm"', 1.0, 1000.0, 25.4 / 96),
    ],
)
def test_units_of_the_sheet(
    tmp_path: Path, sheet: str, scale: float, height: float, mm: float | None
) -> None:
    page = drawn(tmp_path, LINE, sheet=sheet)
    expected = [[[100 * scale, height - 900 * scale], [600 * scale, height - 900 * scale]]]
    assert np.allclose(page.ends, expected, rtol=1e-4)
    assert page.page_mm_per_unit == mm
    assert page.sheet is not None
    assert page.sheet[3] == pytest.approx(height, rel=1e-5)


def test_a_view_box_off_the_origin_is_moved_into_the_sheet(tmp_path: Path) -> None:
    page = drawn(tmp_path, LINE, sheet='width="200mm" height="100mm" viewBox="100 0 2000 1000"')
    assert np.allclose(page.ends, [[[0, 10], [50, 10]]], atol=1e-3)


def test_transforms_and_uses_are_followed(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        '<defs><g id="door"><line x1="0" y1="0" x2="10" y2="0" stroke="black"/></g></defs>'
        '<g transform="translate(100 200)"><g transform="rotate(90)">'
        '<use xlink:href="#door" x="50" transform="scale(2)"/></g></g>',
    )
    assert np.allclose(page.ends, [[[10, 70], [10, 68]]], atol=1e-3)


def test_groups_are_layers_and_pens_are_inherited(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        "<style>.w{stroke:#f00;stroke-width:8;fill:none}</style>"
        f'<g xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" inkscape:label="Walls" id="layer1">'
        f'<g id="g12"><rect x="10" y="10" width="100" height="50" class="w"/></g></g>'
        f'<g id="furniture" stroke="#00f" stroke-dasharray="4 2">{LINE.replace("black", "#00f")}</g>'
        '<path class="door-swing" d="M 0 0 L 9 0" stroke="#123456"/>',
    )
    assert [page.layer_names[i] for i in page.layer] == ["Walls", "furniture", "door-swing"]
    assert page.colour.tolist() == [0xFF0000, 0x0000FF, 0x123456]
    assert page.dashed.tolist() == [False, True, False]
    assert page.width == pytest.approx([0.8, 0.1, 0.1], rel=1e-4)
    assert page.closed.tolist() == [True, False, False]


def test_fills_masks_and_what_is_not_displayed(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        '<rect x="0" y="0" width="10" height="10" fill="#555"/><rect width="9" height="9" fill="white"/>'
        f'<rect width="9" height="9" fill="none"/><g style="display: none">{LINE}</g>'
        f'<g visibility="hidden">{LINE}</g>',
    )
    assert page.kind.tolist() == ["solid", "mask"]
    assert page.filled.tolist() == [True, True]
    assert [f.code for f in page.findings] == ["layer-hidden"]


def test_arcs_are_known_and_curves_fine_enough(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        '<path d="M 300 200 A 100 100 0 0 1 200 300" stroke="black" fill="none"/>'
        '<circle cx="500" cy="500" r="80" stroke="black" fill="none"/>'
        '<path d="M 0 0 C 0 400 400 400 400 0" stroke="black" fill="none"/>',
    )
    assert page.arcs is not None
    assert len(page.arcs) == 2
    assert page.arcs[0] == pytest.approx([20, 80, 10, 0, -math.pi / 2], abs=1e-3)
    assert abs(page.arcs[1, 4]) == pytest.approx(2 * math.pi, rel=1e-6)
    curve = page.ends[page.entity == 2]
    t = np.linspace(0, 1, 20_000)
    exact = np.column_stack([120 * (1 - t) * t**2 + 40 * t**3, 100 - 120 * (1 - t) * t])
    middle = curve.mean(axis=1)
    assert max(np.hypot(*(exact - m).T).min() for m in middle) < 0.02


def test_texts_have_place_height_and_angle(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        '<text x="500" y="250" font-size="50">Scale 1:100</text>'
        '<text font-size="20" text-anchor="middle" transform="translate(100 400) rotate(-90)">4.50</text>',
    )
    first, second = page.texts
    assert (first.text, first.angle) == ("Scale 1:100", 0)
    assert first.height == pytest.approx(3.6, rel=1e-3)
    assert first.y == pytest.approx(75 + 1.8, rel=1e-3)
    assert second.angle == pytest.approx(math.pi / 2)
    assert (second.x, second.y) == pytest.approx((10 - 0.72, 60), abs=0.01)


def test_the_usual_doctype_is_read(tmp_path: Path) -> None:
    doctype = (
        '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    )
    assert len(drawn(tmp_path, LINE, head=doctype).ends) == 1


LAUGHS = "<!DOCTYPE svg [<!ENTITY a0 'ha'>" + "".join(
    f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12)
)


@pytest.mark.parametrize(
    "doctype",
    [
        LAUGHS + "]>",
        "<!DOCTYPE svg [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>",
        "<!DOCTYPE svg [<!ENTITY % p SYSTEM 'http://127.0.0.1:9/x.dtd'> %p;]>",
    ],
)
def test_entities_are_refused(tmp_path: Path, doctype: str) -> None:
    with pytest.raises(FileMalformed, match="entities"):
        drawn(tmp_path, "<text>&a11;</text>", head=doctype)


def test_references_to_elsewhere_are_never_opened_and_said(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        LINE + '<image width="9" height="9" xlink:href="http://127.0.0.1:9/plan.png"/>'
        '<use href="other.svg#walls"/><style>@import url(http://127.0.0.1:9/x.css);</style>',
    )
    (finding,) = page.findings
    assert (finding.code, finding.values) == ("external-reference", {"references": 3})
    assert len(page.ends) == 1


def test_uses_that_multiply_are_refused(tmp_path: Path) -> None:
    bomb = '<g id="u0">' + LINE + "</g>"
    bomb += "".join(f'<g id="u{i}">{f"""<use xlink:href="#u{i - 1}"/>""" * 10}</g>' for i in range(1, 10))
    with pytest.raises(DrawingTooComplex):
        drawn(tmp_path, f"<defs>{bomb}</defs><use xlink:href='#u9'/>")


def test_a_use_of_itself_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileMalformed, match="itself"):
        drawn(tmp_path, '<g id="a"><use href="#b"/></g><g id="b"><use href="#a"/></g>')


@pytest.mark.parametrize(
    "body",
    [
        "<g>" * 3000 + "</g>" * 3000,
        LINE * 3000,
        f'<path stroke="black" d="M0 0{"L1 1L2 0" * 2000}"/>',
        "".join(f'<g id="c{i}"><use href="#c{i + 1}"/></g>' for i in range(900)),
    ],
)
def test_deep_many_and_long_are_refused(tmp_path: Path, body: str) -> None:
    with pytest.raises(DrawingTooComplex):
        drawn(tmp_path, body, bounds=Bounds(max_strokes=8000))


def test_a_large_file_is_refused_unread(tmp_path: Path) -> None:
    with pytest.raises(DrawingTooComplex, match="MB of text"):
        drawn(tmp_path, " " * 3_000_000, bounds=Bounds(max_page_bytes=1 << 20))


def test_numbers_that_are_none_are_left_out(tmp_path: Path) -> None:
    page = drawn(
        tmp_path,
        LINE + '<polyline points="0,0 1e300,5 9,9" stroke="black" fill="none"/>'
        '<path d="M 0 0 L 1e999 4" stroke="black" fill="none"/>',
    )
    assert np.isfinite(page.ends).all()
    assert len(page.ends) == 1
    assert [f.code for f in page.findings] == ["strokes-without-place"]


@pytest.mark.parametrize(
    "sheet", ['width="0" height="0"', 'viewBox="0 0 1e30 1e30"', "", 'width="-5mm" height="9mm"']
)
def test_a_sheet_without_size_is_refused(tmp_path: Path, sheet: str) -> None:
    with pytest.raises(FileMalformed, match="size"):
        drawn(tmp_path, LINE, sheet=sheet)


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cut.svg"
    whole = f'<svg {PLAIN} {SHEET}><g id="walls">{LINE}</g></svg>'
    for size in range(len(whole)):
        path.write_text(whole[:size])
        with pytest.raises((FileEmpty, FileTruncated, FileMalformed)):
            load_svg(path)


def test_any_damaged_letter_reads_or_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "damaged.svg"
    whole = bytearray(
        f'<svg {PLAIN} {SHEET}><g transform="rotate(5)"><path d="M0 0 A 5 5 0 0 1 9 9 C 1 2 3 4 5 6" '
        f'stroke="black"/>{LINE}<text x="5" y="9" font-size="3">1:50</text></g></svg>'.encode()
    )
    random = np.random.default_rng(7)
    for _ in range(200):
        broken = bytearray(whole)
        for at in random.integers(0, len(whole), size=2):
            broken[at] = random.integers(32, 127)
        path.write_bytes(broken)
        try:
            load_svg(path)
        except DomainError:
            continue
