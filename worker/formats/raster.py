"""Scanned or exported drawings, images of pixels, to a sheet of grey pixels."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileMalformed,
    FileTruncated,
    ImageTooLarge,
    PageNeeded,
    PageNotFound,
    UnsupportedMedia,
)
from service.domain.findings import Finding
from worker.formats.darkest import darkest_channel
from worker.formats.jpeg_check import check_jpeg
from worker.formats.tiff_pages import TiffPage, list_tiff_pages
from worker.geometry.drawing.raster.sheet import Sheet

_FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")
_TIFF = (b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+")
_JPEG = b"\xff\xd8\xff"
_MAGIC = (b"\x89PNG\r\n\x1a\n", _JPEG, b"BM", b"RIFF", *_TIFF)
_ORIENTATION_TAG = 0x0112
_TURNS = {3: "by 180 degrees", 6: "by 90 degrees clockwise", 8: "by 90 degrees counter-clockwise"}
_MOST_DPI = 1e5
_LISTED, _SHOWN = 200, 8
_SQUARE = 0.02
_LEAST_TILE_PIXELS = 1 << 24


def load_sheet(path: Path, *, bounds: Bounds | None = None, page: int | None = None) -> Sheet:
    """Return the drawing as a sheet of grey pixels, 255 where the paper is bare.

    The grey of a pixel is its darkest colour channel, so that a cyan or yellow pen is as good as a black
    one. Transparency is laid over white, the EXIF orientation is applied: coordinates are those of the
    picture as every viewer shows it. The header is read first: an image over the limit is refused before a
    pixel is decoded. What kind the file is, its own bytes tell, not its name.

    Parameters
    ----------
    path : Path
        An image; 1, 8 or 16 bits, grey, palette, RGB or CMYK, with or without
        transparency.
    bounds : Bounds, optional
        `max_pixels` is the largest image that is decoded.
    page : int, optional
        Page of a TIFF, counted from 1; has to be named where it has several. Thumbnails and masks are no
        pages. The other kinds have one page.

    Returns
    -------
    Sheet
        Row 0 is the top. `dpi` is what the file states, often 72 or 96 whatever the truth: a hint. Findings
        tell of a page that was taken, of a turned photograph, of damage and of pixels that are not square.

    Raises
    ------
    FileEmpty
        If the file has no bytes or the image no pixel.
    UnsupportedMedia
        If the bytes are no image of a kind that is read.
    ImageTooLarge
        If width times height is over `bounds.max_pixels`.
    PageNeeded
        If the file has several pages and none was named.
    PageNotFound
        If the file has no such page.
    FileTruncated
        If the pixels end before the header says.
    FileMalformed
        If the pixels cannot be decoded.

    Notes
    -----
    Decoding is Pillow's, whose errors tell a cut file; OpenCV gives the missing rows as paper or black.
    Memory is five bytes a pixel at the peak for colours, two for grey.
    """
    bounds = bounds or Bounds()
    with _open(path) as head, _refusals(path):
        pages = _pages(path, head)
        chosen = _chosen(pages, page, path)
        _check_tile(chosen, bounds, path)
        _check_bytes(chosen, path)
        with _no_limit_of_pillow(), Image.open(path, formats=_FORMATS) as image:
            if chosen is not None and chosen.directory:
                image.seek(chosen.directory)
            _check_size(image, bounds, path)
            orientation = int(image.getexif().get(_ORIENTATION_TAG, 1))
            dpi, findings = _resolution(image)
            if head.startswith(_JPEG):
                findings.extend(check_jpeg(path.read_bytes(), name=path.name))
            image.load()
            turned_by_pillow = _ORIENTATION_TAG not in image.getexif()
            grey = darkest_channel(image)
    if not turned_by_pillow:
        grey = _turned(grey, orientation)
    if page is not None and len(pages) > 1:
        findings.append(_page_finding(page, len(pages)))
    if orientation in _TURNS:
        findings.append(_turn_finding(orientation))
    return Sheet(np.ascontiguousarray(grey), dpi, findings=tuple(findings))


def load_dpi(path: Path) -> float | None:
    """Return the resolution that the file itself states [pixels an inch], or None where it states none.

    Many programs write 72 or 96 whatever the truth: it is a hint, never the scale.
    """
    try:
        with _no_limit_of_pillow(), Image.open(path, formats=_FORMATS) as image:
            return _resolution(image)[0]
    except (OSError, ValueError, SyntaxError, TypeError, struct.error):
        return None


@contextmanager
def _open(path: Path) -> Iterator[bytes]:
    """Give the first bytes of a file that is an image of a kind that is read."""
    with path.open("rb") as file:
        head = file.read(16)
    if not head:
        raise FileEmpty(f"{path.name} has no bytes; upload the drawing again.")
    if not head.startswith(_MAGIC) or (head.startswith(b"RIFF") and head[8:12] not in (b"WEBP", b"")):
        raise UnsupportedMedia(
            f"{path.name} does not begin as an image of a kind that is read, whatever its name says; "
            "export the drawing as a PNG image."
        )
    if head.startswith(b"RIFF"):
        stated = int.from_bytes(head[4:8], "little") + 8
        if path.stat().st_size < stated - 1:
            raise FileTruncated(
                f"{path.name} is cut short: {path.stat().st_size} of its {stated} bytes are there. "
                "Upload it again."
            )
    yield head


@contextmanager
def _no_limit_of_pillow() -> Iterator[None]:
    """Set Pillow's own limit of pixels and its warnings aside: the limit here is ours, and checked first."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            yield
        finally:
            Image.MAX_IMAGE_PIXELS = limit


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    """Turn what the decoder says of a bad file into the refusals of this service."""
    try:
        yield
    except UnidentifiedImageError as error:
        raise FileTruncated(f"{path.name} ends or breaks within its header; upload it again.") from error
    except (OSError, EOFError, struct.error) as error:
        if "truncated" in str(error).lower() or isinstance(error, EOFError):
            raise FileTruncated(f"{path.name} is cut short: {error}. Upload it again.") from error
        raise FileMalformed(f"{path.name} cannot be decoded: {error}.") from error
    except (ValueError, SyntaxError, IndexError, KeyError, TypeError, OverflowError) as error:
        raise FileMalformed(f"{path.name} cannot be decoded: {error}.") from error


def _pages(path: Path, head: bytes) -> tuple[TiffPage | None, ...]:
    return list_tiff_pages(path) if head.startswith(_TIFF) else (None,)


def _chosen(pages: tuple[TiffPage | None, ...], page: int | None, path: Path) -> TiffPage | None:
    """Return the page that was asked for, or the only one; None for a kind without pages."""
    count = len(pages)
    if page is not None and not 1 <= page <= count:
        raise PageNotFound(f"{path.name} has {count} page(s); page {page} was asked for.", pages=count)
    if page is None and count > 1:
        sizes = [(i + 1, p.width, p.height) for i, p in enumerate(pages[:_LISTED]) if p is not None]
        listed = ", ".join(f"{i}: {width} x {height} px" for i, width, height in sizes[:_SHOWN])
        more = f", and {count - _SHOWN} more" if count > _SHOWN else ""
        raise PageNeeded(
            f"{path.name} has {count} pages ({listed}{more}); say which one shows the floor plan, from 1.",
            pages=[{"page": i, "width_px": width, "height_px": height} for i, width, height in sizes],
            page_count=count,
        )
    return pages[(page or 1) - 1]


def _check_tile(page: TiffPage | None, bounds: Bounds, path: Path) -> None:
    """Refuse a TIFF whose single tile is far larger than any image that is read."""
    if page is not None and page.tile_pixels > max(_LEAST_TILE_PIXELS, min(bounds.max_pixels, 1 << 26)):
        raise ImageTooLarge(
            f"{path.name} is stored in tiles of {page.tile_pixels} pixels; save it without tiles.",
            max_pixels=bounds.max_pixels,
            width=page.width,
            height=page.height,
        )


def _check_bytes(page: TiffPage | None, path: Path) -> None:
    """Refuse a TIFF that is smaller than its page can be packed to."""
    size = path.stat().st_size
    if page is not None and size < page.least_bytes:
        raise FileTruncated(
            f"{path.name} is cut short: a page of {page.width} x {page.height} pixels needs "
            f"{page.least_bytes} bytes or more, and the file has {size}. Upload it again.",
            width=page.width,
            height=page.height,
        )


def _check_size(image: Image.Image, bounds: Bounds, path: Path) -> None:
    width, height = image.size
    if width < 1 or height < 1:
        raise FileEmpty(f"{path.name} has no pixels.")
    if width * height > bounds.max_pixels:
        raise ImageTooLarge(
            f"{path.name} has {width} x {height} pixels; at most {bounds.max_pixels} are read. "
            "Export it at a lower resolution.",
            max_pixels=bounds.max_pixels,
            width=width,
            height=height,
        )


def _resolution(image: Image.Image) -> tuple[float | None, list[Finding]]:
    """Return the stated dpi, and a finding where it differs along the two sides, as on faxes."""
    stated = image.info.get("dpi")
    across, down = (float(stated[0]), float(stated[1])) if stated else (0.0, 0.0)
    if not (0.0 < across < _MOST_DPI and 0.0 < down < _MOST_DPI):
        return None, []
    if abs(across - down) <= _SQUARE * max(across, down):
        return across, []
    message = (
        f"The file states {across:g} pixels an inch across and {down:g} down: where that is true, lengths "
        "along the two sides have different scales. Export it with square pixels."
    )
    values = {"dpi_across": across, "dpi_down": down}
    return None, [Finding("pixels-not-square", "serious", message, values)]


def _turned(grey: NDArray[np.uint8], orientation: int) -> NDArray[np.uint8]:
    if orientation not in range(2, 9):
        return grey
    picture = Image.fromarray(grey)
    picture.getexif()[_ORIENTATION_TAG] = orientation
    return np.array(ImageOps.exif_transpose(picture))


def _page_finding(page: int, count: int) -> Finding:
    return Finding("page-of-several", "info", f"Page {page} of {count} was read.", {"page": page})


def _turn_finding(orientation: int) -> Finding:
    return Finding(
        "picture-turned",
        "info",
        f"The picture was turned {_TURNS[orientation]}, as its camera or scanner noted.",
        {"exif_orientation": orientation},
    )
