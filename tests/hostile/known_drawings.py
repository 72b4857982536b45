"""Drawings that once took a worker down, with their sisters: small, and costly or meaningless."""

from __future__ import annotations

import io
import math
import struct
import zlib
from collections.abc import Callable

import ezdxf

from tests.formats import cad_plans, pdf_writer
from tests.hostile import drawings
from tests.hostile.known import READING, Known

_MANY = 100_000
_CLAIM = (14_000, 14_000)


def _drawing(make: Callable[[], bytes], ends: str, finding: str | None = None) -> Known:
    return Known("drawings", make, ends, finding)


# --- PDF: what draws itself, or the other, twice at each of 40 depths ---------------------------------------

_BOX = b"/BBox[0 0 400 200]"
_FORM = b"/Type/XObject/Subtype/Form" + _BOX


def _page(content: bytes, resources: bytes, *more: bytes) -> bytes:
    lines = b"0.7 w 20 20 m 380 20 l 380 180 l 20 180 l s 200 20 m 200 180 l S\n"
    return pdf_writer.one_page(lines + content, resources=resources, more=more)


def _form(content: bytes, resources: bytes = b"") -> bytes:
    own = b"/Resources<<%s>>" % resources if resources else b""
    return pdf_writer.stream(content, _FORM + own)


def _two_forms(*, inherited: bool = False) -> bytes:
    names = b"/XObject<</A 6 0 R/B 7 0 R>>"
    own = b"" if inherited else names
    return _page(b"/A Do", names, _form(b"/B Do /B Do", own), _form(b"/A Do /A Do", own))


def _pattern_of_itself() -> bytes:
    names = b"/Pattern<</P 6 0 R>>"
    tile = b"/Type/Pattern/PatternType 1/PaintType 1/TilingType 1/BBox[0 0 9 9]/XStep 9/YStep 9"
    content = b"/Pattern cs /P scn 0 0 9 9 re f /P scn 1 1 9 9 re f"
    return _page(
        b"/Pattern cs /P scn 50 50 90 90 re f",
        names,
        pdf_writer.stream(content, tile + b"/Resources<<%s>>" % names),
    )


def _letter_of_itself() -> bytes:
    font = (
        b"<</Type/Font/Subtype/Type3/FontBBox[0 0 9 9]/FontMatrix[0.1 0 0 0.1 0 0]/CharProcs<</a 7 0 R>>"
        b"/Encoding<</Type/Encoding/Differences[97/a]>>/FirstChar 97/LastChar 97/Widths[9]"
        b"/Resources<</Font<</T 6 0 R>>>>>>"
    )
    letter = pdf_writer.stream(b"9 0 d0 BT /T 9 Tf (aaaaaaaa) Tj ET 0 0 9 9 re f")
    page = pdf_writer.one_page(
        b"0.7 w 20 20 m 380 20 l 380 180 l 20 180 l s 200 20 m 200 180 l S BT /T 9 Tf 50 50 Td (aaaa) Tj ET",
        more=[font, letter],
    )
    return page.replace(b"/Font<</F 5 0 R>>", b"/Font<</T 6 0 R>>")


def _mask_of_itself() -> bytes:
    names = b"/ExtGState<</G 6 0 R>>/XObject<</X 7 0 R>>"
    state = b"<</Type/ExtGState/SMask<</S/Luminosity/G 7 0 R>>>>"
    group = _FORM + b"/Group<</S/Transparency/CS/DeviceGray>>/Resources<<%s>>" % names
    return _page(b"/G gs /X Do", names, state, pdf_writer.stream(b"/G gs /X Do /G gs /X Do", group))


def _chain_of_forms() -> bytes:
    forms = [_form(b"/X Do /X Do", b"/XObject<</X %d 0 R>>" % (7 + k)) for k in range(30)]
    return _page(b"/X Do", b"/XObject<</X 6 0 R>>", *forms, _form(b"0 0 m 9 9 l S"))


def _nested_states() -> bytes:
    return _page(b"q " * 2_000_000, b"")


def _packed_twice() -> bytes:
    once = zlib.compress(b"0 0 m 9 9 l S\n" * 10_000_000, 9)
    twice = zlib.compress(once, 9)
    head = b"<</Filter[/FlateDecode/FlateDecode]/Length %d>>stream\n" % len(twice)
    document = pdf_writer.one_page(b"")
    return document.replace(b"<</Length 0>>stream\n", head + twice)


# --- images that claim more than they hold ------------------------------------------------------------------


def _claiming_jpeg(*, progressive: bool = False) -> bytes:
    sink = io.BytesIO()
    drawings.plan_image().save(sink, "JPEG", quality=70, progressive=progressive)
    content = bytearray(sink.getvalue())
    frame = content.find(b"\xff\xc2" if progressive else b"\xff\xc0")
    content[frame + 5 : frame + 9] = struct.pack(">HH", _CLAIM[1], _CLAIM[0])
    return bytes(content)


def _holed_jpeg() -> bytes:
    content = drawings.MAKERS["jpeg"]()
    middle = len(content) // 2
    return content[:middle] + b"\x55" * 400 + content[middle + 400 :]


def _padded_jpeg() -> bytes:
    content = drawings.MAKERS["jpeg"]()
    return content[:-2] + b"\x55" * 400 + content[-2:]


def _claiming_png() -> bytes:
    content = bytearray(drawings.MAKERS["png"]())
    content[16:24] = struct.pack(">II", *_CLAIM)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    return bytes(content)


def _wide_strokes() -> bytes:
    image = drawings.plan_image().resize((1260, 900))
    image.paste(0, (60, 120, 1200, 720))
    sink = io.BytesIO()
    image.save(sink, "PNG")
    return sink.getvalue()


def _claiming_bmp() -> bytes:
    content = bytearray(drawings.MAKERS["bmp"]())
    content[18:26] = struct.pack("<II", *_CLAIM)
    return bytes(content)


def _tiff(mode: str, compression: str) -> bytes:
    sink = io.BytesIO()
    drawings.plan_image(mode).save(sink, "TIFF", compression=compression)
    return sink.getvalue()


def _claiming_tiff(right: bytes, *, strips: bool = True) -> bytes:
    """Return a TIFF whose directory claims another width and height (tags 256, 257), in one strip (278)."""
    content = bytearray(right)
    at = struct.unpack_from("<I", content, 4)[0]
    for k in range(struct.unpack_from("<H", content, at)[0]):
        entry = at + 2 + 12 * k
        tag = struct.unpack_from("<H", content, entry)[0]
        if tag in (256, 257):
            struct.pack_into("<HII", content, entry + 2, 4, 1, _CLAIM[tag - 256])
        if tag == 278 and not strips:
            struct.pack_into("<HII", content, entry + 2, 4, 1, _CLAIM[1])
    return bytes(content)


def _claiming_webp(kind: str) -> bytes:
    """Return a WebP whose extended header claims a larger canvas (RFC 9649, 2.7.1)."""
    frame = drawings.MAKERS[kind]()[12:]
    canvas = struct.pack("<I", _CLAIM[0] - 1)[:3] + struct.pack("<I", _CLAIM[1] - 1)[:3]
    body = b"WEBPVP8X" + struct.pack("<I", 10) + bytes(4) + canvas + frame
    return b"RIFF" + struct.pack("<I", len(body)) + body


def _claiming_lossless_webp() -> bytes:
    """Return a lossless WebP whose own 14 bits claim the largest size (RFC 9649, 3.4)."""
    content = bytearray(drawings.MAKERS["lossless.webp"]())
    at = content.find(b"VP8L") + 9
    bits = int.from_bytes(content[at : at + 4], "little")
    content[at : at + 4] = (bits & ~0xFFFFFFF | (_CLAIM[1] - 1) << 14 | (_CLAIM[0] - 1)).to_bytes(4, "little")
    return bytes(content)


def _claiming_pgm(kind: bytes) -> bytes:
    return kind + b"\n%d %d\n255\n" % _CLAIM + bytes([48]) * 4000


def _scanned(picture: bytes, packed_by: bytes, size: tuple[int, int]) -> bytes:
    head = b"/Subtype/Image/Width %d/Height %d/BitsPerComponent 8/ColorSpace/DeviceGray/Filter/%s"
    return pdf_writer.one_page(
        b"q 210 0 0 150 0 0 cm /Im Do Q",
        page=b"/MediaBox[0 0 210 150]",
        resources=b"/XObject<</Im 6 0 R>>",
        more=[
            b"<<%s/Length %d>>stream\n" % (head % (*size, packed_by), len(picture)) + picture + b"\nendstream"
        ],
    )


def _bomb() -> bytes:
    packer, block = zlib.compressobj(9), b"\xff" * (1 << 20)
    return b"".join(packer.compress(block) for _ in range(4096)) + packer.flush()


# --- SVG: lengths -------------------------------------------------------------------------------------------


_PENS = (
    'stroke-width="0.5em"', 'stroke-width="1ex"', 'stroke-width="0.1rem"', 'stroke-width="1%"',
    'stroke-width="0.3vw"', 'stroke-width="calc(1px + 1em)"', 'stroke-width="thick"', 'stroke-width=""',
    'stroke-width="1e308em"', 'stroke-width="nan"', 'stroke-width="inherit"', 'style="stroke-width:0.5em"',
    'font-size="2em" stroke-width="0.5em"', 'class="w"',
)  # fmt: skip
_LETTERS = (
    'font-size="0.5em"', 'font-size="larger"', 'style="font-size:2em"', 'font-size="1e308em"', 'font-size=""',
    'font-size="9" dx="1em" dy="1ex"', 'font-size="nan"', 'letter-spacing="0.1em"', 'x="1em" y="5%"',
)  # fmt: skip


def _svg_of(attributes: tuple[str, ...]) -> bytes:
    """Return the right sheet with a line and a text more for each of the attributes."""
    more = "".join(f'<path d="M0 0L9 9" stroke="#000" {a}/><text {a}>1:100</text>' for a in attributes)
    style = "<style>.w{stroke-width:0.5em} text{font-size:2em}</style>"
    return drawings.MAKERS["svg"]().replace(b"<defs>", f"{style}{more}<defs>".encode())


# --- DXF: curves of very many points ------------------------------------------------------------------------


def _dxf_with(add: Callable[[ezdxf.document.Drawing], object]) -> Callable[[], bytes]:
    def make() -> bytes:
        doc = cad_plans.new_drawing()
        cad_plans.draw_plan(doc, 1000.0)
        add(doc)
        sink = io.StringIO()
        doc.write(sink)
        return sink.getvalue().encode()

    return make


def _wave(count: int = _MANY) -> list[tuple[float, float]]:
    return [(20_000.0 * k / count, 9_000.0 + 500.0 * math.sin(k / 9.0)) for k in range(count)]


def _hatch(doc: ezdxf.document.Drawing, *, fitted: bool) -> None:
    edges = doc.modelspace().add_hatch().paths.add_edge_path()
    if fitted:
        edges.add_spline(fit_points=_wave(), control_points=_wave(4), knot_values=[0.0] * 4 + [1.0] * 4)
    else:
        edges.add_spline(control_points=_wave(), knot_values=[float(k) for k in range(_MANY + 4)])


def _steep_spline(doc: ezdxf.document.Drawing) -> None:
    doc.modelspace().add_open_spline(_wave(4_000), degree=2_000)


def _nan_spline(doc: ezdxf.document.Drawing) -> None:
    doc.modelspace().add_spline([(0, 0), (1e300, 1e300), (1e154, -1e300), (5, 5)])


def _array(doc: ezdxf.document.Drawing, spacing: float) -> None:
    doc.blocks.new("DOT").add_circle((0, 0), 100)
    grid = {"row_count": 30_000, "column_count": 30_000, "row_spacing": spacing, "column_spacing": spacing}
    doc.modelspace().add_blockref("DOT", (5_000, 5_000), dxfattribs=grid)


def _arcs() -> bytes:
    arcs = '<path fill="none" stroke="#000" d="M0 100' + "a1 1 0 0 1 2 0" * _MANY + '"/>'
    return drawings.MAKERS["svg"]().replace(b"<defs>", arcs.encode() + b"<defs>")


def _star(count: int = 6_001) -> bytes:
    angles = (math.pi * (1 - 1 / count) * k for k in range(count))
    points = [b"%.3f %.3f" % (200 + 90 * math.cos(a), 100 + 90 * math.sin(a)) for a in angles]
    return _page(points[0] + b" m " + b" l ".join(points[1:]) + b" l f", b"")


KNOWN_DRAWINGS: dict[str, Known] = {
    "PDF form of itself": _drawing(
        lambda: _page(b"/A Do", b"/XObject<</A 6 0 R>>", _form(b"/A Do /A Do", b"/XObject<</A 6 0 R>>")),
        "drawing-too-complex",
    ),
    "PDF form of itself, names of the page": _drawing(
        lambda: _page(b"/A Do", b"/XObject<</A 6 0 R>>", _form(b"/A Do /A Do")), "drawing-too-complex"
    ),
    "PDF form of itself, name escaped": _drawing(
        lambda: _page(b"/A#41 Do", b"/XObject<</AA 6 0 R>>", _form(b"/#41A Do /A#41 Do")),
        "drawing-too-complex",
    ),
    "PDF two forms of each other": _drawing(_two_forms, "drawing-too-complex"),
    "PDF two forms of each other, names of the page": _drawing(
        lambda: _two_forms(inherited=True), "drawing-too-complex"
    ),
    "PDF pattern of itself": _drawing(_pattern_of_itself, "drawing-too-complex"),
    "PDF letter of itself": _drawing(_letter_of_itself, READING),
    "PDF mask of itself": _drawing(_mask_of_itself, "drawing-too-complex"),
    "PDF chain of 30 forms": _drawing(_chain_of_forms, "drawing-too-complex"),
    "PDF states in each other": _drawing(_nested_states, "drawing-too-complex"),
    "PDF packed twice": _drawing(_packed_twice, "drawing-too-complex"),
    "JPEG claiming 196 Mpx": _drawing(_claiming_jpeg, "file-truncated"),
    "progressive JPEG claiming 196 Mpx": _drawing(lambda: _claiming_jpeg(progressive=True), "file-truncated"),
    "JPEG with a hole": _drawing(_holed_jpeg, "file-truncated"),
    "JPEG with noise before its end": _drawing(_padded_jpeg, READING, "pixels-damaged"),
    "PNG of a stroke 600 px wide": _drawing(_wide_strokes, READING),
    "PNG claiming 196 Mpx": _drawing(_claiming_png, "file-truncated"),
    "BMP claiming 196 Mpx": _drawing(_claiming_bmp, "file-truncated"),
    **{
        f"{kind} claiming 196 Mpx": _drawing(
            lambda kind=kind: _claiming_tiff(drawings.MAKERS[kind]()), "file-malformed"
        )
        for kind in ("tiff", "tiles.tiff")
    },
    **{
        f"TIFF of {compression} claiming 196 Mpx in one strip": _drawing(
            lambda m=mode, c=compression: _claiming_tiff(_tiff(m, c), strips=False), end
        )
        for mode, compression, end in (
            ("1", "group4", "file-truncated"),
            ("L", "jpeg", "file-truncated"),
            ("L", "packbits", "file-malformed"),
            ("L", "tiff_lzw", "file-malformed"),
        )
    },
    "scanned PDF of a JPEG claiming 196 Mpx": _drawing(
        lambda: _scanned(_claiming_jpeg(), b"DCTDecode", _CLAIM), "file-truncated"
    ),
    "scanned PDF of a cut JPEG": _drawing(
        lambda: _scanned(drawings.MAKERS["jpeg"]()[:3000], b"DCTDecode", drawings.SIZE), "file-truncated"
    ),
    "scanned PDF of pixels claiming 196 Mpx": _drawing(
        lambda: _scanned(zlib.compress(bytes(100_000)), b"FlateDecode", _CLAIM), "file-truncated"
    ),
    "scanned PDF of pixels that unpack to 4 GB": _drawing(
        lambda: _scanned(_bomb(), b"FlateDecode", drawings.SIZE), "no-walls-found"
    ),
    "WebP claiming 196 Mpx": _drawing(lambda: _claiming_webp("webp"), "file-malformed"),
    "lossless WebP claiming 196 Mpx": _drawing(_claiming_lossless_webp, "file-malformed"),
    "PGM claiming 196 Mpx": _drawing(lambda: _claiming_pgm(b"P5"), "image-too-large"),
    "text PGM claiming 196 Mpx": _drawing(lambda: _claiming_pgm(b"P2"), "image-too-large"),
    **{
        f"SVG with {attribute}": _drawing(lambda attribute=attribute: _svg_of((attribute,)), READING)
        for attribute in _PENS[:3]
    },
    "SVG with pens of every length": _drawing(lambda: _svg_of(_PENS), READING),
    "SVG with letters of every length": _drawing(lambda: _svg_of(_LETTERS), READING),
    "DXF spline fitted to 100,000 points": _drawing(
        _dxf_with(lambda doc: doc.modelspace().add_spline(_wave())), READING
    ),
    "DXF spline of 100,000 control points": _drawing(
        _dxf_with(lambda doc: doc.modelspace().add_open_spline(_wave())), READING
    ),
    "DXF rational spline of 100,000 control points": _drawing(
        _dxf_with(lambda doc: doc.modelspace().add_rational_spline(_wave(), [1.0] * _MANY)), READING
    ),
    "DXF spline of degree 2,000": _drawing(_dxf_with(_steep_spline), READING),
    "DXF spline of no places": _drawing(_dxf_with(_nan_spline), READING),
    "DXF hatch along a spline fitted to 100,000 points": _drawing(
        _dxf_with(lambda doc: _hatch(doc, fitted=True)), READING
    ),
    "DXF hatch along a spline of 100,000 control points": _drawing(
        _dxf_with(lambda doc: _hatch(doc, fitted=False)), READING
    ),
    "DXF polyline of 20,000 bulges": _drawing(
        _dxf_with(
            lambda doc: doc.modelspace().add_lwpolyline([(x, y, 0.5) for x, y in _wave(20_000)], format="xyb")
        ),
        READING,
    ),
    "DXF array of a pile": _drawing(_dxf_with(lambda doc: _array(doc, 0.0)), READING),
    "DXF array of 10^9": _drawing(_dxf_with(lambda doc: _array(doc, 1.0)), "drawing-too-complex"),
    "DXF formatted text of 200,000 codes": _drawing(
        _dxf_with(lambda doc: doc.modelspace().add_mtext("{\\fArial|b0;x}" * 200_000)), READING
    ),
    "SVG of 100,000 arcs": _drawing(_arcs, "drawing-too-complex"),
    "PDF of a filled star of 6,000 points": _drawing(_star, READING),
}
"""The drawings, by what they are."""
