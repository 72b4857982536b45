"""The images of scanned pages that hold less than they say, and those that hold all in fewest bits."""

from __future__ import annotations

import io
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
