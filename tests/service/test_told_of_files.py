"""What a person is told of a file: by its name, in text that can be shown, whatever the file holds."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests import files
from tests.formats.cad_plans import draw_plan, new_drawing, saved
from tests.service.desks import Desk


def test_one_flipped_bit_that_is_no_text_poisons_nothing(desk: Desk, tmp_path: Path) -> None:
    doc = new_drawing()
    draw_plan(doc, 1000.0)
    whole = bytearray(saved(doc, tmp_path / "plan.dxf").read_bytes())
    whole[whole.index(b"$ACADMAINTVER")] ^= 0x80
    problem = desk.told("drawings", "hall 2.dxf", bytes(whole))
    assert problem["detail"].startswith("hall 2.dxf breaks the rules of DXF")
    assert '"\N{REPLACEMENT CHARACTER}ACADMAINTVER"' in problem["detail"]


CUT = {
    "plan.png": files.png(400, 300)[:-5000],
    "plan.bmp": b"BM" + (5000).to_bytes(4, "little") + bytes(48),
    "plan.tif": b"II*\0" + (8).to_bytes(4, "little") + bytes(40),
    "plan.dxf": b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n",
    "plan.dwg": b"AC1032" + bytes(200),
    "plan.svg": b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg"><g>',
    "plan.ifc": b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=IFCWALL(",
    "plan.pgm": b"P5\n400 300\n255\n" + bytes(100),
    "map.yaml": b"image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n",
    "a.pdf": b"%PDF-1.7\n1 0 obj",
    "building.yaml": b"levels:\n  L1:\n    walls: []\n",
}


@pytest.mark.parametrize("name", CUT)
def test_a_problem_calls_the_file_by_its_name(desk: Desk, name: str) -> None:
    shown = f"Halle Süd {name}"
    problem = desk.told("drawings", shown, CUT[name])
    assert shown in problem["detail"], problem
    assert problem["file_name"] == shown


SCANS = {
    "a.ply": files.ply(files.room())[:-1000],
    "a.las": b"LASF" + bytes(400),
    "a.e57": b"ASTM-E57" + bytes(400),
    "a.usda": b"#usda 1.0\n(\n",
    "a.glb": b"glTF" + (2).to_bytes(4, "little") + bytes(40),
    "a.obj": b"v 1 2 3\nf 1 2 9\n",
    "a.stl": b"solid a\nfacet normal 0 0 1\n",
    "a.csv": b"x,y,z\n1,2,3\n1,2\n",
}


@pytest.mark.parametrize("name", SCANS)
def test_no_problem_calls_a_scan_by_its_digest(desk: Desk, name: str) -> None:
    shown = f"Halle Süd {name}"
    sent = desk.sent("scans", shown, SCANS[name])
    told = sent.json() if sent.status_code == 422 else desk.told("scans", shown, SCANS[name])
    assert not re.search(r"[0-9a-f]{40}", told["detail"]), json.dumps(told)
    assert sent.status_code == 422 or (shown in told["detail"] and told["file_name"] == shown), told


@pytest.mark.parametrize("name", ["..", "a/b.dxf", "図面" * 120 + ".dxf", "-rf.dxf", "x\n.dxf"])
def test_a_strange_name_is_only_a_name(desk: Desk, name: str) -> None:
    problem = desk.told("drawings", name, CUT["plan.dxf"] + name.encode())
    assert problem["type"].rpartition("/")[2] == "file-truncated", problem
