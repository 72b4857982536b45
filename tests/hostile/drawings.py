"""A small right drawing of every kind that is taken, the same bytes each time."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import ezdxf
from PIL import Image, ImageDraw

from tests.formats import cad_plans, ifc_models, pdf_writer

Point = tuple[float, float]

SIZE = (420, 300)
"""Of the drawings in pixels."""

_GUID = re.compile(r"'[0-9A-Za-z_$]{22}'")


def plan_image(mode: str = "L") -> Image.Image:
    """Return a plan of two rooms with a door, a dimension and a text, 420 x 300 pixels."""
    image = Image.new("L", SIZE, 255)
    draw = ImageDraw.Draw(image)
    draw.rectangle((40, 40, 380, 230), outline=0, width=7)
    draw.line([(210, 40), (210, 110)], fill=0, width=4)
    draw.line([(210, 150), (210, 230)], fill=0, width=4)
    draw.arc((170, 110, 250, 190), 0, 90, fill=0)
    draw.line([(40, 265), (380, 265)], fill=0)
    draw.text((180, 250), "10,00", fill=0)
    draw.text((90, 120), "OFFICE 1:100", fill=0)
    return image.convert(mode)


def _image(kind: str, mode: str = "L", **how: object) -> bytes:
    sink = io.BytesIO()
    plan_image(mode).save(sink, kind, **how)
    return sink.getvalue()


def _progressive() -> bytes:
    return _image("JPEG", "RGB", quality=70, progressive=True, dpi=(150, 150))


def _tiff_of_tiles() -> bytes:
    return _image("TIFF", compression="tiff_adobe_deflate", tiffinfo={322: 128, 323: 128})


def _pgm(*, text: bool = False) -> bytes:
    wide, high = (84, 60) if text else (140, 100)
    image = plan_image().resize((wide, high))
    head = b"%s\n# a map\n%d %d\n255\n" % (b"P2" if text else b"P5", wide, high)
    if not text:
        return head + image.tobytes()
    rows = [" ".join(str(v) for v in image.crop((0, y, wide, y + 1)).tobytes()) for y in range(high)]
    return head + "\n".join(rows).encode() + b"\n"


_MAP_YAML = (
    b"image: map.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
)


def _ros_zip(*, packed: bool = True) -> bytes:
    sink = io.BytesIO()
    how = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with zipfile.ZipFile(sink, "w") as archive:
        for name, content in (("map.yaml", _MAP_YAML), ("map.pgm", _pgm())):
            archive.writestr(zipfile.ZipInfo(name, (2026, 1, 1, 0, 0, 0)), content, how)
    return sink.getvalue()


def _building() -> bytes:
    corners = [(100, 900), (300, 900), (345, 900), (600, 900), (600, 600), (100, 600)]
    vertices = "".join(f"      - [{x}, {y}, 0.0, '', {{}}]\n" for x, y in corners)
    walls = "".join(
        f"      - [{a}, {b}, {{texture_name: [1, default]}}]\n" for a, b in ((0, 1), (2, 3), (3, 4), (5, 0))
    )
    return (
        "name: plant\nlevels:\n  L1:\n    drawing: {filename: floor.png}\n    elevation: 0\n"
        f"    vertices:\n{vertices}    walls:\n{walls}"
        "    doors:\n      - [1, 2, {name: [1, d], type: [1, hinged]}]\n"
        "    measurements:\n      - [0, 3, {distance: [3, 10.0]}]\n      - [3, 4, {distance: [3, 6.0]}]\n"
        "    lanes:\n      - [0, 4, {bidirectional: [4, true]}]\n"
        "    floors:\n      - {parameters: {}, vertices: [0, 3, 4, 5]}\n"
        "    models:\n      - {name: Chair, model_name: Chair, x: 300.0, y: 800.0, yaw: 0.1}\n"
    ).encode()


def _strokes() -> list[tuple[Point, Point]]:
    return [(a, b) for a, b in cad_plans.face_lines(15.0, x=2.0, y=2.0)]


def _page_content() -> bytes:
    lines = "\n".join(f"{a[0]:.2f} {a[1]:.2f} m {b[0]:.2f} {b[1]:.2f} l S" for a, b in _strokes())
    more = "q 0.5 0 0 0.5 100 60 cm /Fm Do Q\n0.9 g 60 60 40 30 re f\n10 20 30 40 50 60 c S\n"
    return f"0.7 w\n{lines}\n{more}BT /F 9 Tf 90 190 Td (Scale 1:100) Tj ET\n".encode()


def _pdf(*, pack: bool = False) -> bytes:
    form = pdf_writer.stream(
        b"0 0 m 40 0 l 40 30 l h S", b"/Type/XObject/Subtype/Form/BBox[0 0 50 50]/Resources<<>>", pack=pack
    )
    measure = b"/VP[<</BBox[0 0 400 240]/Measure<</Subtype/RL/R(1:100)/X[<</U(m)/C 0.0353>>]>>>>]"
    return pdf_writer.one_page(
        _page_content(),
        page=b"/MediaBox[0 0 400 240]" + measure,
        resources=b"/XObject<</Fm 6 0 R>>",
        more=[form],
        pack=pack,
    )


def _scanned_pdf() -> bytes:
    picture = zlib.compress(plan_image().tobytes(), 9)
    head = b"/Subtype/Image/Width 420/Height 300/BitsPerComponent 8/ColorSpace/DeviceGray/Filter/FlateDecode"
    image = b"<<%s/Length %d>>stream\n" % (head, len(picture)) + picture + b"\nendstream"
    return pdf_writer.one_page(
        b"q 210 0 0 150 0 0 cm /Im Do Q",
        page=b"/MediaBox[0 0 210 150]",
        resources=b"/XObject<</Im 6 0 R>>",
        more=[image],
    )


def _svg() -> bytes:
    lines = "".join(
        f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}"/>' for a, b in _strokes()
    )
    return (
        '<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" width="120mm" height="80mm" '
        'viewBox="0 0 340 220"><defs><path id="d" d="M0 0 L20 0 A20 20 0 0 1 0 20 Z '
        'M3 3 q4 4 8 0 c1 1 2 2 3 3"/>'
        f'</defs><g id="walls" stroke="#000" stroke-width="0.7" fill="none">{lines}'
        '<rect x="30" y="30" width="40" height="20"/><circle cx="90" cy="60" r="12"/>'
        '<use href="#d" transform="translate(150 75) rotate(30) scale(1.5)"/></g>'
        '<text x="100" y="150" font-size="9" stroke-dasharray="3 2">1:100</text></svg>\n'
    ).encode()


def _dxf(*, binary: bool = False) -> bytes:
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        doc = cad_plans.new_drawing()
        cad_plans.draw_plan(doc, 1000.0)
        _more_entities(doc)
        if binary:
            packed = io.BytesIO()
            doc.write(packed, fmt="bin")  # type: ignore[arg-type]  # ezdxf types the stream as one of text
            return packed.getvalue()
        sink = io.StringIO()
        doc.write(sink)
        return sink.getvalue().encode()
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before


def _more_entities(doc: ezdxf.document.Drawing) -> None:
    """Draw one of each kind of entity that is read beside lines."""
    block = doc.blocks.new("CHAIR")
    block.add_circle((0, 0), 300)
    block.add_lwpolyline([(0, 0, 0.3), (400, 0, 0.0), (400, 400, -0.5)], format="xyb", close=True)
    model = doc.modelspace()
    attribs = {"row_count": 2, "column_count": 3, "row_spacing": 900, "column_spacing": 900}
    model.add_blockref("CHAIR", (12_000, 7_000), dxfattribs=attribs)
    model.add_spline([(1000, 9000), (2000, 9800), (3000, 9000), (4000, 9900)])
    model.add_ellipse((7000, 9000), (800, 0), 0.4)
    model.add_mtext("ROOM 1\\P12 m2", dxfattribs={"char_height": 250, "insert": (4000, 7000)})
    model.add_polyline2d([(500, 500), (900, 500), (900, 900)], close=True)
    hatch = model.add_hatch()
    hatch.paths.add_polyline_path([(15_000, 1000), (16_000, 1000), (16_000, 2000)], is_closed=True)
    model.add_solid([(17_000, 1000), (17_500, 1000), (17_000, 1500), (17_500, 1500)])
    model.add_linear_dim(base=(0, -900), p1=(0, 0), p2=(20_000, 0)).render()
    sheet = doc.paperspace()
    sheet.add_viewport((100, 100), (180, 120), view_center_point=(10_000, 6_000), view_height=14_000)
    sheet.add_text("1:100", height=4)


def _ifc() -> bytes:
    with TemporaryDirectory() as folder:
        text = ifc_models.small_house().write(Path(folder) / "house.ifc").read_text()
    known: dict[str, str] = {}
    text = _GUID.sub(lambda m: known.setdefault(m[0], f"'{len(known):022d}'"), text)
    return re.sub(r"'\d{4}-\d\d-\d\dT[^']*'", "'2026-01-01T00:00:00'", text).encode()


MAKERS: dict[str, Callable[[], bytes]] = {
    "png": lambda: _image("PNG", "RGB", dpi=(150, 150)),
    "palette.png": lambda: _image("PNG", "P"),
    "jpeg": lambda: _image("JPEG", quality=70, dpi=(150, 150)),
    "progressive.jpeg": _progressive,
    "tiff": lambda: _image("TIFF", compression="tiff_lzw", dpi=(150, 150)),
    "tiles.tiff": _tiff_of_tiles,
    "fax.tiff": lambda: _image("TIFF", "1", compression="group4"),
    "big.tiff": lambda: _image("TIFF", big_tiff=True, compression="packbits"),
    "bmp": lambda: _image("BMP", "1"),
    "webp": lambda: _image("WEBP", "RGB", quality=70),
    "lossless.webp": lambda: _image("WEBP", "RGB", lossless=True),
    "pdf": _pdf,
    "packed.pdf": lambda: _pdf(pack=True),
    "scanned.pdf": _scanned_pdf,
    "svg": _svg,
    "dxf": _dxf,
    "binary.dxf": lambda: _dxf(binary=True),
    "ifc": _ifc,
    "pgm": _pgm,
    "text.pgm": lambda: _pgm(text=True),
    "map.zip": _ros_zip,
    "stored.zip": lambda: _ros_zip(packed=False),
    "map.yaml": lambda: _MAP_YAML,
    "building.yaml": _building,
}
"""What makes a drawing, by the name of its kind."""
