"""The images of a scanned PDF page held against what they say: pdfium paints over what is missing."""

from __future__ import annotations

import ctypes
import zlib
from contextlib import suppress
from ctypes import byref
from typing import Any

import pypdfium2.raw as pdfium

from service.domain.errors import FileTruncated
from service.domain.findings import Finding
from worker.formats.jpeg_check import check_jpeg

_JPEG, _FLATE = "DCTDecode", "FlateDecode"
_NAME = "The page's image"
_LONGEST_NAME = 64
_CHUNK = 1 << 20


def check_image(item: Any, page: Any) -> tuple[Finding, ...]:
    """Return what is wrong with an image object of a page, both pdfium's, whose pixels can all be decoded.

    Raises
    ------
    FileTruncated
        If a JPEG's data end before its last pixel, or those of Flate before its last row.

    Notes
    -----
    Data in several filters, JPEG 2000, JBIG2 and fax are not looked into.
    """
    filters = _filters(item)
    if filters == [_JPEG]:
        return check_jpeg(_raw(item), name=_NAME)
    if filters == [_FLATE]:
        _check_rows(item, page)
    return ()


def _check_rows(item: Any, page: Any) -> None:
    wide, high = ctypes.c_uint(), ctypes.c_uint()
    facts = pdfium.FPDF_IMAGEOBJ_METADATA()
    pdfium.FPDFImageObj_GetImagePixelSize(item, byref(wide), byref(high))
    if not pdfium.FPDFImageObj_GetImageMetadata(item, page, byref(facts)):
        return
    bits = (
        facts.bits_per_pixel // 8 or 1
    )  # pdfium tells 8 for a component that is stored in 1, 2 or 4 as well
    least = (wide.value * bits + 7) // 8 * high.value
    found = _unpacked_bytes(_raw(item), most=least)
    if found < least:
        raise FileTruncated(
            f"{_NAME} is cut short: its {wide.value} x {high.value} pixels need {least} bytes or more, "
            f"and it has {found}. Export the document anew."
        )


def _unpacked_bytes(raw: bytes, *, most: int) -> int:
    """Return to how many bytes the data unpack, as far as they can be and to `most`; none of them is kept."""
    inflater, pending, count = zlib.decompressobj(), raw, 0
    with suppress(zlib.error):
        while pending and count < most and not inflater.eof:
            count += len(inflater.decompress(pending, _CHUNK))
            pending = inflater.unconsumed_tail
    return count


def _filters(item: Any) -> list[str]:
    held = ctypes.create_string_buffer(_LONGEST_NAME)
    names = []
    for k in range(pdfium.FPDFImageObj_GetImageFilterCount(item)):
        pdfium.FPDFImageObj_GetImageFilter(item, k, held, _LONGEST_NAME)
        names.append(held.value.decode("latin-1"))
    return names


def _raw(item: Any) -> bytes:
    size = pdfium.FPDFImageObj_GetImageDataRaw(item, None, 0)
    held = ctypes.create_string_buffer(size)
    pdfium.FPDFImageObj_GetImageDataRaw(item, held, size)
    return held.raw
