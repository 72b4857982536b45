"""Plans as PDF and SVG files through the one way that the command line and the jobs take."""

import math
from pathlib import Path
from typing import Any

import pytest
import shapely

from service.domain.drawing_options import DrawingOptions
from service.domain.errors import PageNeeded
from tests.formats.pdf_writer import one_page, pdf_bytes
from tests.geometry.page_plans import CORNER, Plan, a_plan, agreement
from worker.formats.drawing import read_drawing_file

MM = 72 / 25.4
A3 = b"/MediaBox[0 0 1190.55 841.89]"
SWING = 0.5522847498


def rings(plan: Plan, ratio: float) -> list[list[list[tuple[float, float]]]]:
    """Return the outlines of each body of a plan [mm of the page], the outer one first."""
    mm = 1000 / ratio
    return [
        [
            [(CORNER[0] + x * mm, CORNER[1] + y * mm) for x, y in ring.coords[:-1]]
            for ring in (body.exterior, *body.interiors)
        ]
        for body in shapely.get_parts(plan.material)
    ]


def pdf_plan(plan: Plan, ratio: float, *, title: str) -> bytes:
    """Return the content of a page in mm: walls in outline, door swings, a desk a door, a title."""
    out = [f"{MM:.6f} 0 0 {MM:.6f} 0 0 cm 0.5 w"]
    for body in rings(plan, ratio):
        for ring in body:
            out += [f"{x:.4f} {y:.4f} {'l' if i else 'm'}" for i, (x, y) in enumerate(ring)] + ["h S"]
    out.append("0.13 w")
    mm = 1000 / ratio
    for door in plan.doors:
        x, y, r = CORNER[0] + door[0] * mm, CORNER[1] + door[1] * mm, door[2] * mm
        out.append(f"{x} {y} m {x} {y + r} l S {x + r} {y} m")
        out.append(f"{x + r} {y + SWING * r} {x + SWING * r} {y + r} {x} {y + r} c S")
        out.append(f"{x + r} {y + 2 * r} {1.5 * r} {0.8 * r} re S")
    out.append(f"BT /F 4 Tf 1 0 0 1 350 12 Tm ({title}) Tj ET")
    return "\n".join(out).encode()


def svg_plan(plan: Plan, ratio: float, *, title: str, walls: str) -> str:
    """Return the same as an SVG of an A3 sheet, the walls as filled compound paths in a group."""
    mm = 1000 / ratio

    def y_down(points: list[tuple[float, float]]) -> str:
        return "M" + "L".join(f"{x:.4f} {297 - y:.4f}" for x, y in points) + "Z"

    paths = "".join(
        f'<path fill="#444" fill-rule="evenodd" d="{"".join(y_down(r) for r in body)}"/>'
        for body in rings(plan, ratio)
    )
    doors = ""
    for door in plan.doors:
        x, y, r = CORNER[0] + door[0] * mm, 297 - CORNER[1] - door[1] * mm, door[2] * mm
        doors += f'<path fill="none" stroke="#888" d="M{x + r} {y}A{r} {r} 0 0 0 {x} {y - r}L{x} {y}"/>'
        doors += f'<rect x="{x + r}" y="{y - 3 * r}" width="{r}" height="{r}" fill="none" stroke="#888"/>'
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" width="420mm" height="297mm" viewBox="0 0 420 297">'
        f'<g id="{walls}">{paths}</g><g id="plain" stroke-width="0.13">{doors}</g>'
        f'<text x="350" y="285" font-size="4">{title}</text></svg>'
    )


def read(path: Path, **said: Any) -> Any:
    return read_drawing_file(path, options=DrawingOptions(**said))


@pytest.mark.parametrize("turn", [0, 90])
def test_a_drawn_pdf_is_read_with_its_own_scale(tmp_path: Path, turn: int) -> None:
    path = tmp_path / "plan.pdf"
    plan = a_plan(81)
    content = pdf_plan(plan, 100, title="Scale 1:100")
    path.write_bytes(one_page(content, page=A3 + b"/Rotate %d" % turn, pack=True))
    reading = read(path)
    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == pytest.approx(0.1)
    assert reading.sheet == pytest.approx((42.0, 29.7) if turn == 0 else (29.7, 42.0), abs=1e-3)
    if turn == 90:  # undo the turn: x right, y up goes to y, width - x
        undone = shapely.affinity.affine_transform(plan.material, [0, 1, -1, 0, 0, 0])
        plan = Plan(
            shapely.affinity.translate(
                undone, CORNER[1] / 10 - CORNER[0] / 10, 42.0 - CORNER[0] / 10 - CORNER[1] / 10
            ),
            (),
        )
    precision, recall = agreement(reading, plan, 100)
    assert min(precision, recall) >= 0.97


def test_a_page_of_several_has_to_be_chosen_and_is_read(tmp_path: Path) -> None:
    path = tmp_path / "set.pdf"
    plan = a_plan(82)
    content = pdf_plan(plan, 100, title="M 1:100")
    whole = one_page(content, page=A3)
    body = content.decode("latin-1")
    pages = [
        b"<</Type/Page/Parent 2 0 R%s/Contents 4 0 R/Resources<</Font<</F 5 0 R>>>>>>" % A3,
        b"<</Length %d>>stream\n%s\nendstream" % (len(body), content),
        b"<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>",
        b"<</Type/Page/Parent 2 0 R/MediaBox[0 0 595 842]>>",
    ]
    kids = b"<</Type/Pages/Kids[6 0 R 3 0 R]/Count 2>>"
    path.write_bytes(pdf_bytes([b"<</Type/Catalog/Pages 2 0 R>>", kids, *pages]))
    with pytest.raises(PageNeeded) as refusal:
        read(path)
    assert [p["page"] for p in refusal.value.members["pages"]] == [1, 2]
    chosen = read(path, page=2)
    path.write_bytes(whole)
    alone = read(path)
    assert sum(w.length for w in chosen.walls) == pytest.approx(sum(w.length for w in alone.walls))


@pytest.mark.parametrize("walls", ["walls", "g1"])
def test_an_svg_is_read_by_its_groups_or_by_its_fills(tmp_path: Path, walls: str) -> None:
    path = tmp_path / "plan.svg"
    plan = a_plan(83)
    path.write_text(svg_plan(plan, 100, title="1:100", walls=walls), encoding="utf-8")
    reading = read(path)
    assert reading.scale.metres_per_unit == pytest.approx(0.1, rel=1e-6)
    precision, recall = agreement(reading, plan, 100)
    assert min(precision, recall) >= 0.97
    assert {x.role for x in reading.layers if x.name == "walls"} == ({"wall"} if walls == "walls" else set())


def test_a_door_is_as_wide_as_the_page_says() -> None:
    """The swing that the writer draws is a quarter circle to a fraction of a per mille."""
    t = 0.5
    middle = (1 - t) ** 3 + 3 * (1 - t) ** 2 * t + 3 * (1 - t) * t * t * SWING
    assert math.hypot(middle, middle) == pytest.approx(1.0, abs=3e-4)


def test_the_real_finish_plan(shared_data: Path) -> None:
    reading = read(shared_data / "drawings" / "pdf_sample-finish-plan.pdf", page=1)
    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == pytest.approx(0.096, rel=1e-6)
    assert 900 <= sum(w.length for w in reading.walls) <= 1400
    points = [p for w in reading.walls for p in w.centre]
    assert 70 <= max(x for x, _ in points) - min(x for x, _ in points) <= 74
