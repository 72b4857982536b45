"""The images of a scanned PDF page held against what they say: pdfium paints over what is missing."""

from __future__ import annotations

import ctypes
import io
import zlib
from contextlib import suppress
from ctypes import byref
from typing import Any

import pypdfium2.raw as pdfium
from PIL import Image

from service.domain.errors import FileTruncated
from service.domain.findings import Finding
from worker.formats.jbig2_check import check_jbig2
from worker.formats.jpeg_check import check_jpeg

_JPEG, _FLATE, _FAX, _JBIG2, _JPX = "DCTDecode", "FlateDecode", "CCITTFaxDecode", "JBIG2Decode", "JPXDecode"
_TINTED = (pdfium.FPDF_COLORSPACE_INDEXED, pdfium.FPDF_COLORSPACE_SEPARATION, pdfium.FPDF_COLORSPACE_DEVICEN)
_GREY_BITS = 8
_COARSEST, _SMALL_PIXELS = 3, 4_000_000
_NAME = "The page's image"
_LONGEST_NAME = 64
_CHUNK = 1 << 20


def check_image(item: Any, page: Any) -> tuple[Finding, ...]:
    """Return what is wrong with an image object of a page, both pdfium's, whose pixels can all be decoded.

    Raises
    ------
    FileTruncated
        If a JPEG's data end before its last pixel, those of Flate before its last row, or those of JBIG2
        before their last segment; if its page of JBIG2 is lower than the image; if a fax has fewer bits than
        rows.

    Notes
    -----
    Data in several filters are not looked into. A fax that has fewer rows than its header says, but more
    bits, is not recognised: nothing but a decoder of its own can tell.
    """
    filters, data = _filters(item), _raw(item)
    if filters == [_JPEG]:
        return check_jpeg(data, name=_NAME)
    if filters == [_FLATE]:
        _check_rows(item, page, data)
    elif filters == [_FAX]:
        _check_size(item, least=(_size(item)[1] + 7) // 8, found=len(data))
    elif filters == [_JBIG2]:
        check_jbig2(data, height=_size(item)[1], name=_NAME)
    elif filters == [_JPX]:
        return _check_jpx(data, _size(item))
    return ()


def is_coloured(item: Any, page: Any) -> bool:
    """Return whether an image object of a page, both pdfium's, may have other colours than greys."""
    facts = pdfium.FPDF_IMAGEOBJ_METADATA()
    if not pdfium.FPDFImageObj_GetImageMetadata(item, page, byref(facts)):
        return True
    return facts.bits_per_pixel > _GREY_BITS or facts.colorspace in _TINTED


def _check_jpx(data: bytes, size: tuple[int, int]) -> tuple[Finding, ...]:
    """Return the finding that a JPEG 2000 cannot be decoded strictly, as pdfium does not."""
    said = _unreadable(data, reduce=_COARSEST)
    if said is None:
        return ()
    if size[0] * size[1] <= _SMALL_PIXELS:  # it may be too small to be reduced
        said = _unreadable(data, reduce=0)
    if said is None:
        return ()
    message = f"The image's data are damaged ({said}): parts of it may be white, blurred or missing."
    return (Finding("pixels-damaged", "warning", message),)


def _unreadable(data: bytes, *, reduce: int) -> str | None:
    """Return why an image cannot be decoded at a size of 1 : 2^reduce, or None where it can."""
    try:
        with Image.open(io.BytesIO(data)) as image:
            image.reduce = reduce  # type: ignore[method-assign,assignment]  # how Pillow's reader is told
            image.load()
    except (OSError, ValueError, SyntaxError) as error:
        return str(error)
    return None


def _check_rows(item: Any, page: Any, data: bytes) -> None:
    facts = pdfium.FPDF_IMAGEOBJ_METADATA()
    if not pdfium.FPDFImageObj_GetImageMetadata(item, page, byref(facts)):
        return
    wide, high = _size(item)
    bits = (
        facts.bits_per_pixel // 8 or 1
    )  # pdfium tells 8 for a component that is stored in 1, 2 or 4 as well
    least = (wide * bits + 7) // 8 * high
    _check_size(item, least=least, found=_unpacked_bytes(data, most=least))


def _check_size(item: Any, *, least: int, found: int) -> None:
    if found < least:
        wide, high = _size(item)
        raise FileTruncated(
            f"{_NAME} is cut short: its {wide} x {high} pixels need {least} bytes or more, and it has "
            f"{found}. Export the document anew."
        )


def _size(item: Any) -> tuple[int, int]:
    wide, high = ctypes.c_uint(), ctypes.c_uint()
    pdfium.FPDFImageObj_GetImagePixelSize(item, byref(wide), byref(high))
    return wide.value, high.value


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
