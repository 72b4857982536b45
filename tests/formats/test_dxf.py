from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from ezdxf.filemanagement import readfile
from ezdxf.math import Matrix44

from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from service.domain.errors import (
    DrawingTooComplex,
    FileEmpty,
    FileMalformed,
    FileTruncated,
    InvalidRequest,
    NotFinite,
    UploadTooLarge,
)
from service.domain.scale_hint import ScaleHint
from tests.formats.cad_plans import draw_plan, face_lines, new_drawing, saved
from worker.formats.drawing import read_drawing_file
from worker.formats.dwg import load_dwg
from worker.formats.dxf import load_dxf
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.reading.reading import Reading

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
CODES = {"in": 1, "ft": 2, "mm": 4, "cm": 5, "m": 6}


def load(path: Path) -> Linework:
    return load_dxf(path, bounds=Bounds())


def read(path: Path, **said: object) -> Reading:
    return read_drawing_file(path, options=DrawingOptions(**said))  # type: ignore[arg-type]  # one option each


def codes(drawn: Linework | Reading) -> set[str]:
    return {f.code for f in drawn.findings}


def samples(lines: list[np.ndarray]) -> np.ndarray:
    out = []
    for line in lines:
        for a, b in itertools.pairwise(line):
            n = max(2, math.ceil(float(np.hypot(*(b - a))) / 0.02))
            out.append(a + (b - a) * np.linspace(0, 1, n)[:, None])
    return np.vstack(out)


def assert_faces(reading: Reading, x: float = 0.0, y: float = 0.0) -> None:
    """Assert that the faces are the plan's wall lines, no more and no less, to 2 cm."""
    truth = samples([np.array(pair) for pair in face_lines(x=x, y=y)])
    faces = samples([f for w in reading.walls for f in w.faces]) + reading.origin
    gap = np.hypot(*(truth[:, None] - faces[None]).transpose(2, 0, 1))
    assert gap.min(axis=1).max() < 0.02
    assert gap.min(axis=0).max() < 0.02


def test_a_plan_is_read_with_faces_thickness_and_everything_else_set_aside(tmp_path: Path) -> None:
    doc = new_drawing(6)
    draw_plan(doc, x=100.0, y=-50.0)
    reading = read(saved(doc, tmp_path / "plan.dxf"))
    assert_faces(reading, 100.0, -50.0)
    assert reading.origin == (100.0, -50.0)
    assert {round(w.thickness, 3) for w in reading.walls if w.thickness > 0} == {0.3, 0.1}
    assert {(layer.name, layer.role) for layer in reading.layers} == {
        ("A-WALL", "wall"),
        ("A-DOOR", "door"),
        ("FURN", "furniture"),
    }
    assert {r.layer for r in reading.removed} == {"door", "furniture", "text"}


def test_the_wall_layers_can_be_chosen(tmp_path: Path) -> None:
    doc = new_drawing(6)
    draw_plan(doc)
    path = saved(doc, tmp_path / "plan.dxf")
    reading = read(path, wall_layers=("furn", "gone"))
    assert sum(w.length for w in reading.walls) == pytest.approx(6.0, abs=0.01)
    assert "wall-layer-missing" in codes(reading)
    with pytest.raises(InvalidRequest, match="A-WALL"):
        read(path, wall_layers=("nothing",))


def test_a_solid_hatch_of_several_rings_is_as_many_walls(tmp_path: Path) -> None:
    doc = new_drawing(6)
    hatch = doc.modelspace().add_hatch(dxfattribs={"layer": "A-WALL"})
    rings = face_lines()[:4], face_lines()[4:]
    hatch.paths.add_polyline_path([a for a, _ in rings[0]], is_closed=True, flags=1)
    hatch.paths.add_polyline_path([a for a, _ in rings[1]], is_closed=True, flags=16)
    hatch.paths.add_polyline_path([(4, 4), (4.2, 4), (4.2, 8), (4, 8)], is_closed=True, flags=1)
    reading = read(saved(doc, tmp_path / "hatched.dxf"), scale=ScaleHint(metres_per_unit=1.0))
    apart = [w for w in reading.walls if w.centre[:, 0].min() > 3.9 and w.centre[:, 0].max() < 4.3]
    assert [round(w.thickness, 2) for w in apart] == [0.2]
    assert sum(w.length for w in apart) == pytest.approx(4.0, abs=0.05)
    assert sorted({round(w.thickness, 2) for w in reading.walls}) == [0.1, 0.2, 0.3]
    outer = [w for w in reading.walls if round(w.thickness, 2) == 0.3]
    assert sum(w.length for w in outer) == pytest.approx(2 * (19.7 + 11.7), abs=0.05)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("header", ["right", "wrong", "absent"])
def test_the_unit_is_found_whatever_the_header_says(tmp_path: Path, unit: str, header: str) -> None:
    code = {"right": CODES[unit], "absent": 0, "wrong": CODES["ft" if unit == "mm" else "mm"]}[header]
    doc = new_drawing(code)
    draw_plan(doc, 1.0 / UNITS[unit])
    reading = read(saved(doc, tmp_path / "plan.dxf"))
    assert (reading.scale.state, reading.scale.metres_per_unit) == ("found", UNITS[unit])
    assert_faces(reading)


def test_a_unit_that_only_the_header_tells_is_unknown(tmp_path: Path) -> None:
    doc = new_drawing(4)
    draw_plan(doc, 12.0)
    reading = read(saved(doc, tmp_path / "plan.dxf"))
    assert (reading.scale.state, reading.unit) == ("unknown", "px")
    assert sum(w.length for w in reading.walls) > 12.0 * 60


@pytest.mark.parametrize("unit", UNITS)
def test_real_plans_keep_their_unit_when_they_are_rewritten(
    shared_data: Path, tmp_path: Path, unit: str
) -> None:
    doc = readfile(shared_data / "drawings" / "cad_Aule-scolastiche-pianta-1.dxf")
    matrix = Matrix44.scale(1.0 / UNITS[unit])
    for entity in doc.modelspace():
        entity.transform(matrix)
    for code in (4, 0, CODES["in" if unit != "in" else "cm"]):
        doc.header["$INSUNITS"] = code
        reading = read(saved(doc, tmp_path / "plan.dxf"))
        assert (reading.scale.state, reading.scale.metres_per_unit) == ("found", UNITS[unit])


def test_blocks_are_placed_turned_scaled_and_in_arrays(tmp_path: Path) -> None:
    doc = new_drawing(6)
    block = doc.blocks.new("LEAF", base_point=(1, 0))
    block.add_line((1, 0), (2, 0))
    block.add_arc((1, 0), 1, 0, 90, dxfattribs={"layer": "SWING"})
    block.add_attdef("NAME", (0, 0))
    reference = doc.modelspace().add_blockref(
        "LEAF",
        (10, 20),
        dxfattribs={
            "layer": "A-DOOR",
            "rotation": 90,
            "xscale": 2,
            "yscale": 2,
            "row_count": 1,
            "column_count": 3,
            "column_spacing": 5,
        },
    )
    reference.add_attrib("NAME", "D1", (10, 20))
    drawn = load(saved(doc, tmp_path / "blocks.dxf"))
    leaves = drawn.ends[drawn.kind[drawn.entity] == "line"]
    assert np.allclose(leaves, [[[10, y], [10, y + 2]] for y in (20, 25, 30)])
    assert {drawn.layer_names[n] for n in drawn.layer[drawn.kind == "line"]} == {"A-DOOR"}
    assert drawn.arcs is not None
    assert np.allclose(drawn.arcs, [[10, y, 2, math.pi / 2, math.pi / 2] for y in (20, 25, 30)])
    assert [t.text for t in drawn.texts] == ["D1"]


def test_bulges_mirrored_arcs_and_curves_lie_where_they_are_drawn(tmp_path: Path) -> None:
    doc = new_drawing(6)
    model = doc.modelspace()
    model.add_lwpolyline([(0, 0, 0, 0, 1), (2, 0)], dxfattribs={"layer": "BULGE"})
    model.add_arc((-5, 5), 1, 0, 90, dxfattribs={"layer": "MIRROR", "extrusion": (0, 0, -1)})
    model.add_ellipse((20, 0), (4, 0), 0.5, dxfattribs={"layer": "ELLIPSE"})
    model.add_circle((40, 0), 3, dxfattribs={"layer": "CIRCLE"})
    drawn = load(saved(doc, tmp_path / "curves.dxf"))
    at = {
        name: drawn.ends[drawn.layer[drawn.entity] == n].reshape(-1, 2)
        for n, name in enumerate(drawn.layer_names)
    }
    assert np.allclose(np.hypot(*(at["BULGE"] - (1, 0)).T), 1)
    assert at["BULGE"][:, 1].min() == pytest.approx(-1, abs=0.01)
    assert np.allclose(np.hypot(*(at["MIRROR"] - (5, 5)).T), 1)
    assert np.allclose(at["MIRROR"].min(axis=0), (4, 5), atol=1e-9)
    x, y = (at["ELLIPSE"] - (20, 0)).T
    assert np.allclose((x / 4) ** 2 + (y / 2) ** 2, 1, atol=1e-3)
    assert np.allclose(np.hypot(*(at["CIRCLE"] - (40, 0)).T), 3)


def test_pens_of_layers_are_resolved_and_hidden_layers_left_out(tmp_path: Path) -> None:
    doc = new_drawing(6)
    doc.linetypes.add("GAPS", [1.0, 0.5, -0.5])
    doc.layers.add("HEAVY", color=1, lineweight=50, linetype="GAPS")
    doc.layers.add("OFF").off()
    doc.layers.add("FROZEN").freeze()
    for layer in ("HEAVY", "OFF", "FROZEN"):
        doc.modelspace().add_line((0, 0), (1, 1), dxfattribs={"layer": layer})
    own = {"layer": "HEAVY", "color": 3, "lineweight": 13, "linetype": "CONTINUOUS"}
    doc.modelspace().add_line((0, 0), (2, 1), dxfattribs=own)
    drawn = load(saved(doc, tmp_path / "pens.dxf"))
    assert drawn.layer_names == ("HEAVY",)
    assert drawn.width.tolist() == [0.5, 0.13]
    assert drawn.colour.tolist() == [0xFF0000, 0x00FF00]
    assert drawn.dashed.tolist() == [True, False]
    assert "layer-hidden" in codes(drawn)


def test_dimensions_written_by_hand_name_the_unit(tmp_path: Path) -> None:
    doc = new_drawing(0)
    for start, end in face_lines(100.0):
        doc.modelspace().add_line(start, end, dxfattribs={"layer": "WALL"})
    for x, text in ((500, "5.00"), (700, "7.00"), (1100, "11.00")):
        doc.modelspace().add_linear_dim((0, -100), (0, 0), (x, 0), text=text).render()
    reading = read(saved(doc, tmp_path / "dimensions.dxf"))
    assert reading.scale.metres_per_unit == 0.01
    assert "dimension" in {r.layer for r in reading.removed}


def test_a_binary_file_reads_like_its_text(tmp_path: Path) -> None:
    doc = new_drawing(6)
    draw_plan(doc)
    doc.saveas(tmp_path / "binary.dxf", fmt="bin")
    assert_faces(read(tmp_path / "binary.dxf"))


def test_strays_are_set_aside_and_said(tmp_path: Path) -> None:
    doc = new_drawing(6)
    draw_plan(doc, x=500_000.0, y=4_000_000.0)
    model = doc.modelspace()
    model.add_line((0, 0), (1, 1))
    model.add_line((math.nan, 0), (1, 1))
    model.add_line((0, 0), (1e300, 1))
    model.add_circle((0, 0), math.inf)
    reading = read(saved(doc, tmp_path / "strays.dxf"))
    assert {"strokes-far-away", "strokes-without-place"} <= codes(reading)
    assert max(np.abs(w.centre).max() for w in reading.walls) < 30.0
    assert reading.origin == (500_000.0, 4_000_000.0)
    assert max(reading.sheet) < 30.0


def test_nothing_but_values_that_are_no_numbers_is_refused(tmp_path: Path) -> None:
    doc = new_drawing(6)
    doc.modelspace().add_line((math.nan, 0), (1, 1))
    with pytest.raises(NotFinite):
        load(saved(doc, tmp_path / "nan.dxf"))


@pytest.mark.parametrize("fmt", ["asc", "bin"])
def test_a_file_cut_short_is_refused(tmp_path: Path, fmt: str) -> None:
    doc = new_drawing(6)
    draw_plan(doc)
    doc.saveas(tmp_path / "whole.dxf", fmt=fmt)
    whole = (tmp_path / "whole.dxf").read_bytes()
    (tmp_path / "cut.dxf").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileTruncated):
        load(tmp_path / "cut.dxf")


def test_rubbish_with_an_end_marker_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rubbish.dxf").write_bytes(b"  0\nSECTION\n" + b"abc\ndef\n" * 100 + b"  0\nEOF\n")
    with pytest.raises(FileMalformed):
        load(tmp_path / "rubbish.dxf")


def test_a_broken_group_is_recovered_and_said(tmp_path: Path) -> None:
    doc = new_drawing(6)
    draw_plan(doc)
    text = saved(doc, tmp_path / "whole.dxf").read_text()
    broken = text.replace("SECTION\n  2\nENTITIES\n", "SECTION\n  2\nENTITIES\n  0\nLINE\n 10\nrubbish\n", 1)
    (tmp_path / "broken.dxf").write_text(broken)
    reading = read(tmp_path / "broken.dxf")
    assert codes(reading) & {"file-recovered", "entities-broken"}
    assert_faces(reading)


def test_a_drawing_with_nothing_in_it_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileEmpty):
        load(saved(new_drawing(), tmp_path / "empty.dxf"))


def test_a_file_too_large_is_refused(tmp_path: Path) -> None:
    path = saved(new_drawing(), tmp_path / "large.dxf")
    with pytest.raises(UploadTooLarge):
        load_dxf(path, bounds=Bounds(max_dxf_bytes=100))


def test_a_bomb_of_nested_blocks_is_refused_before_it_is_placed(tmp_path: Path) -> None:
    doc = new_drawing()
    doc.blocks.new("B0").add_line((0, 0), (1, 1))
    for n in range(1, 12):
        block = doc.blocks.new(f"B{n}")
        for k in range(10):
            block.add_blockref(f"B{n - 1}", (k, 0))
    doc.modelspace().add_blockref("B11", (0, 0))
    with pytest.raises(DrawingTooComplex):
        load(saved(doc, tmp_path / "bomb.dxf"))


@pytest.mark.parametrize(
    ("rows", "said"),
    [(30_000, "come to 1800000000 entities; at most 400000"), (700, "more than 2000000 strokes")],
)
@pytest.mark.parametrize("on_sheet", [False, True])
def test_a_bomb_of_an_array_is_refused_before_it_is_placed(
    tmp_path: Path, rows: int, said: str, *, on_sheet: bool
) -> None:
    doc = new_drawing()
    block = doc.blocks.new("B")
    block.add_circle((0, 0), 1)
    block.add_line((0, 0), (1, 1))
    grid = {"row_count": rows, "column_count": rows if rows > 700 else 200}
    doc.modelspace().add_blockref("B", (0, 0), dxfattribs=grid)
    assert len(load(saved(doc, tmp_path / "pile.dxf")).kind) == 2  # without spacing they lie on each other
    doc.modelspace().delete_all_entities()
    layout = doc.paperspace() if on_sheet else doc.modelspace()
    layout.add_blockref("B", (0, 0), dxfattribs={**grid, "row_spacing": 1, "column_spacing": 1})
    with pytest.raises(DrawingTooComplex, match=said):
        load(saved(doc, tmp_path / "array.dxf"))


def test_entities_that_blocks_multiply_are_counted_and_those_of_the_file_are_not(tmp_path: Path) -> None:
    doc = new_drawing()
    doc.blocks.new("B").add_line((0, 0), (1, 1))
    for k in range(10):
        doc.modelspace().add_blockref("B", (k, 0))
        doc.modelspace().add_line((k, 2), (k, 3))
    path = saved(doc, tmp_path / "blocks.dxf")
    assert len(load_dxf(path, bounds=Bounds(max_page_objects=10)).kind) == 20
    with pytest.raises(DrawingTooComplex):
        load_dxf(path, bounds=Bounds(max_page_objects=9))


def test_a_block_within_itself_is_said(tmp_path: Path) -> None:
    doc = new_drawing(6)
    draw_plan(doc)
    block = doc.blocks.new("SELF")
    block.add_line((0, 0), (1, 1))
    block.add_blockref("SELF", (1, 0))
    doc.modelspace().add_blockref("SELF", (3, 3))
    reading = read(saved(doc, tmp_path / "self.dxf"))
    assert "block-in-itself" in codes(reading)
    assert_faces(reading)


def test_a_drawing_of_references_alone_has_no_walls_and_says_which_files_it_wants(tmp_path: Path) -> None:
    doc = new_drawing(4)
    doc.add_xref_def("ground-floor.dwg", "GROUND")
    doc.modelspace().add_blockref("GROUND", (0, 0))
    reading = read(saved(doc, tmp_path / "references.dxf"))
    said = next(f for f in reading.findings if f.code == "only-references")
    assert said.values["references"] == ["ground-floor.dwg"]
    assert (reading.walls, reading.confidence) == ((), 0.0)


def test_a_drawing_on_its_sheet_alone_is_read_from_there(tmp_path: Path) -> None:
    doc = new_drawing(4)
    sheet = doc.layout("Layout1")
    for start, end in face_lines(10.0):
        sheet.add_line(start, end, dxfattribs={"layer": "WALL"})
    sheet.add_text("SCALE 1:100", height=3).set_placement((10, -8))
    reading = read(saved(doc, tmp_path / "sheet.dxf"))
    assert "paper-space-only" in codes(reading)
    assert reading.scale.metres_per_unit == pytest.approx(0.1)
    assert_faces(reading)


def test_a_damaged_dwg_is_refused(tmp_path: Path) -> None:
    (tmp_path / "zeros.dwg").write_bytes(b"AC1032" + bytes(5000))
    with pytest.raises(FileMalformed):
        load_dwg(tmp_path / "zeros.dwg", bounds=Bounds())
    (tmp_path / "stub.dwg").write_bytes(b"AC1032" + bytes(50))
    with pytest.raises(FileTruncated):
        load_dwg(tmp_path / "stub.dwg", bounds=Bounds())


def test_a_dwg_cut_short_is_refused(shared_data: Path, tmp_path: Path) -> None:
    whole = (shared_data / "drawings" / "cad_Scuola-pianta-03.dwg").read_bytes()
    (tmp_path / "cut.dwg").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileMalformed):
        load_dwg(tmp_path / "cut.dwg", bounds=Bounds())


@pytest.mark.parametrize("name", ["cad_Scuola-pianta-03", "cad_schema-ufficio-4"])
def test_dxf_and_dwg_of_one_plan_give_the_same_walls(shared_data: Path, name: str) -> None:
    one, two = (read(shared_data / "drawings" / f"{name}.{kind}") for kind in ("dxf", "dwg"))

    def faces(reading: Reading) -> list[tuple[float, ...]]:
        return sorted(tuple((np.vstack(w.faces).round(3) + 0.0).ravel().tolist()) for w in reading.walls)

    assert one.origin == two.origin
    assert faces(one) == faces(two)


def test_a_dwg_sheet_that_only_refers_knows_its_unit(shared_data: Path) -> None:
    reading = read(shared_data / "drawings" / "cad_A-A1-10-01.dwg")
    assert (reading.scale.state, reading.scale.metres_per_unit) == ("found", 0.001)
    assert "only-references" in codes(reading)
