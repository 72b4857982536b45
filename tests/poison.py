"""Files of every kind with text in them that is none: lone surrogates, NUL, control characters."""

from __future__ import annotations

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from tests import files
from tests.formats import scan_files
from tests.formats.cad_plans import draw_plan, new_drawing, saved
from tests.formats.ifc_models import ModelWriter, house_solids
from tests.formats.pdf_writer import one_page

TEXTS = ("\ud800", "\udcb0x", "a\x00b", "\x1b[2J\x07", "\x85\x9b", "\ufffe\u202e")
"""What a client may write into any text of a form, by the escapes of JSON."""

_BYTES = {
    "bytes that are no UTF-8": b"W\xff\xfe\xed\xa0\x80",
    "control characters": b"W\x1b[2J\x07\x7f",
    "NUL": b"W\x00nde",
}
_HERE = "GPPOISON"
_PLACE = _HERE.encode()
_LINES = "".join(
    f'<path d="M {x} {y} h {w} v {h} h {-w} z" fill="black" stroke="none"/>'
    for x, y, w, h in ((100, 100, 1200, 20), (100, 700, 1200, 20), (100, 100, 20, 620), (1280, 100, 20, 620))
)


def _dxf(folder: Path) -> bytes:
    doc = new_drawing()
    for layer in ("A-WALL", f"{_HERE} DOORS"):
        draw_plan(doc, 1000.0, layer=layer)
    doc.layers.add(f"{_HERE} HIDDEN").off()
    model = doc.modelspace()
    model.add_line((0, 0), (900, 900), dxfattribs={"layer": f"{_HERE} HIDDEN"})
    block = doc.blocks.new(f"{_HERE}BLOCK")
    block.add_line((0, 0), (900, 0))
    model.add_blockref(f"{_HERE}BLOCK", (3000, 3000))
    model.add_text(f"{_HERE} 1:100", height=300)
    return saved(doc, folder / "plan.dxf").read_bytes()


def _ifc(folder: Path) -> bytes:
    model = ModelWriter()
    for n in range(2):
        model.storey(f"{_HERE}{n}", 3.0 * n, house_solids())
    return model.write(folder / "house.ifc").read_bytes()


def _pdf(name: bytes) -> bytes:
    content = b"/OC /W BDC 0.5 g 40 40 300 6 re 40 140 300 6 re f EMC /OC /H BDC 0 0 m 90 90 l S EMC"
    note = b"<</Type/Annot/Subtype/Square/Rect[50 60 90 68]/T(AutoCAD SHX Text)/Contents(%s)>>" % name
    return one_page(
        content,
        page=b"/MediaBox[0 0 400 200]/Annots[8 0 R]",
        resources=b"/Properties<</W 6 0 R/H 7 0 R>>",
        catalogue=b"/OCProperties<</OCGs[6 0 R 7 0 R]/D<</OFF[7 0 R]>>>>",
        more=[b"<</Type/OCG/Name(%s)>>" % name, b"<</Type/OCG/Name(H%s)>>" % name, note],
    )


def _svg(text: bytes) -> bytes:
    return (
        b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape='
        b'"http://www.inkscape.org/namespaces/inkscape" width="148mm" height="82mm" viewBox="0 0 1480 820">'
        b'<g inkscape:groupmode="layer" inkscape:label="%s" id="%s">%s</g><text x="9" y="99">%s 1:100</text>'
        b'<g inkscape:label="H%s" style="display:none">%s</g></svg>'
    ) % (text, text, _LINES.encode(), text, text, _LINES.encode())


def _building(name: str) -> bytes:
    level = '{"vertices": [[0,0,0,""],[500,0,0,""],[500,300,0,""]], "walls": [[0,1,{}],[1,2,{}]]}'
    return f'levels:\n  "{name}": {level}\n  "{name}2": {level}\n'.encode()


def _ros_map(image: str) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("map.yaml", f'image: "{image}.pgm"\nresolution: 0.05\norigin: [0, 0, 0]\n')
        archive.writestr("map.pgm", b"P5\n40 30\n255\n" + bytes(1200))
    return out.getvalue()


def _png(text: bytes) -> bytes:
    whole = files.png(200, 150)
    body = b"tEXt" + text + b"\0" + text
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return whole[:33] + chunk + whole[33:]


def _ply(text: bytes) -> bytes:
    return files.ply(files.room()).replace(
        b"\nelement", b"\ncomment %s\nobj_info %s\nelement" % (text, text), 1
    )


def _glb(name: str) -> bytes:
    tree = json.dumps({"asset": {"version": "2.0", "generator": name}, "scenes": [{"name": name}]}).encode()
    tree += b" " * (-len(tree) % 4)
    return b"glTF" + struct.pack("<II", 2, 20 + len(tree)) + struct.pack("<I", len(tree)) + b"JSON" + tree


def _las(text: bytes, folder: Path) -> bytes:
    path = folder / "scan.las"
    scan_files.las(path, files.room())
    whole = bytearray(path.read_bytes())
    whole[26:58] = whole[58:90] = (text * 32)[:32]
    return bytes(whole)


def drawings(folder: Path) -> dict[str, tuple[str, bytes]]:
    """Return poisoned drawings, each with the name that it is uploaded by."""
    dxf, ifc = _dxf(folder), _ifc(folder)
    found: dict[str, tuple[str, bytes]] = {}
    for what, text in _BYTES.items():
        found[f"DXF, {what}"] = "plan.dxf", dxf.replace(_PLACE, text)
        found[f"SVG, {what}"] = "plan.svg", _svg(text)
        found[f"PDF, {what}"] = "plan.pdf", _pdf(text)
        found[f"IFC, {what}"] = "house.ifc", ifc.replace(_PLACE, text)
        found[f"PNG, {what}"] = "plan.png", _png(text)
    escaped = {"DXF": rb"\U+D800\U+0000\U+001B", "DXF, MIF": rb"\M+1D800"}
    found |= {f"{what}, escapes": ("plan.dxf", dxf.replace(_PLACE, text)) for what, text in escaped.items()}
    found["SVG, references to C1"] = "plan.svg", _svg(b"W&#x9b;&#x85;&#x7f;")
    found["SVG, references to surrogates"] = "plan.svg", _svg(b"W&#xD800;")
    found["PDF, UTF-16"] = "plan.pdf", _pdf(rb"\376\377\330\000\000\000\000\033\334\260")
    found["IFC, escapes"] = "house.ifc", ifc.replace(_PLACE, rb"\X2\D800\X0\\X\1B\X2\0000\X0" + b"\\")
    found["building.yaml, escapes"] = "b.building.yaml", _building(r"\ud800\0\e")
    found["ROS map, escapes"] = "map.zip", _ros_map(r"\ud800\0\e")
    return found


def scans(folder: Path) -> dict[str, tuple[str, bytes]]:
    """Return poisoned scans, each with the name that it is uploaded by."""
    pcd, found = files.pcd(files.room()), dict[str, tuple[str, bytes]]()
    make: dict[str, Callable[[bytes], bytes]] = {
        "scan.ply": _ply,
        "fields.ply": lambda text: files.ply(files.room()).replace(b"float z", b"float " + text, 1),
        "scan.pcd": lambda text: pcd.replace(b"# .PCD", b"# .PCD %s" % text, 1),
        "fields.pcd": lambda text: pcd.replace(b"FIELDS x y z", b"FIELDS x y %s" % text, 1),
        "scan.obj": lambda text: b"# a\nmtllib %s\no %s\nv 1 2 3\nv 2 %s 3\n" % (text, text, text),
        "scan.stl": lambda text: b"solid %s\nfacet normal 0 0 1\nouter loop\nvertex 0 %s 0\n" % (text, text),
        "scan.csv": lambda text: b"x,y,%s\n1,2,3\n4,%s,6\n" % (text, text),
        "scan.usda": lambda text: b'#usda 1.0\n(\n doc = "%s"\n)\ndef %s "%s" {}\n' % (text, text, text),
        "scan.las": lambda text: _las(text, folder),
    }
    for name, made in make.items():
        found |= {f"{name}, {what}": (name, made(text)) for what, text in _BYTES.items()}
    return found | {"GLB, escapes": ("scan.glb", _glb("\ud800\0\x1b"))}
