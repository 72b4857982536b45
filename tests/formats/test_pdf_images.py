"""The images of scanned pages that hold less than they say, and those that hold all in fewest bits."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service.domain.errors import FileTruncated
from tests.formats.pdf_writer import one_page
from worker.formats.pdf import load_pdf
from worker.geometry.drawing.raster.sheet import Sheet

WIDE, HIGH = 403, 300
PALETTE = b"[/Indexed/DeviceRGB 3<000000FF0000FFFFFF0000FF>]"


def scanned(tmp_path: Path, data: bytes, head: bytes) -> Sheet:
    image = b"<</Subtype/Image/Width %d/Height %d%s/Length %d>>stream\n" % (WIDE, HIGH, head, len(data))
    path = tmp_path / "scan.pdf"
    path.write_bytes(
        one_page(
            b"q 210 0 0 150 0 0 cm /Im Do Q",
            page=b"/MediaBox[0 0 210 150]",
            resources=b"/XObject<</Im 6 0 R>>",
            more=[image + data + b"\nendstream"],
        )
    )
    sheet = load_pdf(path)
    assert isinstance(sheet, Sheet)
    return sheet


@pytest.mark.parametrize(
    ("bits", "components", "space"),
    [(1, 1, b"/DeviceGray"), (2, 1, b"/DeviceGray"), (4, 1, b"/DeviceGray"), (8, 1, b"/DeviceGray"),
     (2, 1, PALETTE), (8, 3, b"/DeviceRGB"), (4, 3, b"/DeviceRGB"), (1, 3, b"/DeviceRGB"),
     (8, 4, b"/DeviceCMYK")],
)  # fmt: skip
def test_pixels_of_any_depth_are_all_there_and_a_fortieth_of_them_is_not(
    tmp_path: Path, bits: int, components: int, space: bytes
) -> None:
    rows = np.full((HIGH, (WIDE * bits * components + 7) // 8), 0xAA, dtype=np.uint8).tobytes()
    head = b"/BitsPerComponent %d/ColorSpace%s/Filter/FlateDecode" % (bits, space)
    assert scanned(tmp_path, zlib.compress(rows), head).findings == ()
    with pytest.raises(FileTruncated, match="bytes or more"):
        scanned(tmp_path, zlib.compress(rows[: len(rows) // 40]), head)


def test_a_jpeg_in_a_page_is_judged_as_one_alone(tmp_path: Path) -> None:
    sink = io.BytesIO()
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (HIGH, WIDE), dtype=np.uint8)).save(
        sink, "JPEG"
    )
    whole = sink.getvalue()
    head = b"/BitsPerComponent 8/ColorSpace/DeviceGray/Filter/DCTDecode"
    assert scanned(tmp_path, whole, head).findings == ()
    (finding,) = scanned(tmp_path, whole[:-2] + b"\x55" * 99 + whole[-2:], head).findings
    assert finding.code == "pixels-damaged"
    with pytest.raises(FileTruncated, match="The page's image"):
        scanned(tmp_path, whole[: len(whole) // 2], head)


def test_a_fax_has_a_bit_for_each_row(tmp_path: Path) -> None:
    head = (
        b"/BitsPerComponent 1/ColorSpace/DeviceGray/Filter/CCITTFaxDecode/DecodeParms<</K -1/Columns %d>>"
        % WIDE
    )
    white = b"\xff" * ((HIGH + 7) // 8)  # as above, for each row
    assert scanned(tmp_path, white + b"\x00\x10\x01", head).findings == ()
    with pytest.raises(FileTruncated, match="cut short"):
        scanned(tmp_path, white[:-1], head)


def segment(number: int, kind: int, data: bytes, *, refers: bytes = b"") -> bytes:
    return (
        struct.pack(">IBB", number, kind, len(refers) << 5) + refers + struct.pack(">BI", 1, len(data)) + data
    )


def test_a_jbig2_ends_with_its_last_segment_and_has_the_rows_of_its_image(tmp_path: Path) -> None:
    head = b"/BitsPerComponent 1/ColorSpace/DeviceGray/Filter/JBIG2Decode"
    region = segment(
        1,
        38,
        struct.pack(">IIIIBB", WIDE, HIGH, 0, 0, 0, 0) + b"\x03\xff\xfd\xff\x02\xfe\xfe\xfe" + bytes(99),
    )

    def page(rows: int) -> bytes:
        return segment(0, 48, struct.pack(">IIIIBH", WIDE, rows, 0, 0, 0, 0))

    end = segment(2, 49, b"", refers=b"\x01")
    for whole in (page(HIGH) + region + end, page(0xFFFFFFFF) + region + b"\r\n"):
        assert scanned(tmp_path, whole, head).findings == ()
    for at in (len(page(HIGH)) - 1, len(page(HIGH)) + 11, len(page(HIGH) + region) - 1):
        with pytest.raises(FileTruncated, match="within a segment"):
            scanned(tmp_path, (page(HIGH) + region)[:at], head)
    with pytest.raises(FileTruncated, match=f"{HIGH - 1} rows"):
        scanned(tmp_path, page(HIGH - 1) + region, head)


def test_a_jpeg_2000_that_is_cut_is_told(tmp_path: Path) -> None:
    sink = io.BytesIO()
    noise = np.random.default_rng(1).integers(0, 255, (HIGH, WIDE), dtype=np.uint8)
    Image.fromarray(noise).save(sink, "JPEG2000")
    head = b"/BitsPerComponent 8/ColorSpace/DeviceGray/Filter/JPXDecode"
    assert scanned(tmp_path, sink.getvalue(), head).findings == ()
    (finding,) = scanned(tmp_path, sink.getvalue()[: len(sink.getvalue()) // 2], head).findings
    assert finding.code == "pixels-damaged"


@pytest.mark.parametrize(
    ("space", "bits", "pixel"),
    [(b"/DeviceRGB", 8, b"\xff\xff\x00"), (b"[/Indexed/DeviceRGB 1<FFFFFFFFFF00>]", 8, b"\x01"),
     (b"[/Indexed/DeviceRGB 1<FFFFFFFFFF00>]", 1, b"\xff")],
)  # fmt: skip
def test_a_scan_in_colour_is_seen_by_its_darkest_channel(
    tmp_path: Path, space: bytes, bits: int, pixel: bytes
) -> None:
    rows = (pixel * (WIDE * 8 * len(pixel)))[: (WIDE * bits * len(pixel) + 7) // 8] * HIGH
    head = b"/BitsPerComponent %d/ColorSpace%s/Filter/FlateDecode" % (bits, space)
    assert scanned(tmp_path, zlib.compress(rows), head).grey.max() < 100  # yellow: grey of 0.93
    grey = b"/BitsPerComponent 8/ColorSpace/DeviceGray/Filter/FlateDecode"
    assert scanned(tmp_path, zlib.compress(b"\xed" * (WIDE * HIGH)), grey).grey.min() > 200
