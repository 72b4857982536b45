"""Scanned or exported drawings (PNG, JPEG, TIFF, BMP) to grey pixels."""

from __future__ import annotations

import struct
import warnings
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
    PageNotFound,
    UnsupportedMedia,
)

_FORMATS = ("PNG", "JPEG", "TIFF", "BMP")
_MAGIC = (b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\x00", b"MM\x00*", b"II+\x00", b"MM\x00+", b"BM")
_ORIENTATION_TAG = 0x0112
_SWAPS_SIDES = (5, 6, 7, 8)
_STRIP_ROWS = 512


def load_raster(path: Path, *, bounds: Bounds | None = None, page: int = 1) -> NDArray[np.uint8]:
    """Return the drawing as grey pixels, 255 where the paper is bare.

    The grey of a pixel is its darkest colour channel, so that a cyan or yellow pen is as good as a black
    one. Transparency is laid over white, the EXIF orientation is applied. The header is read first: an image
    over the limit is refused before a pixel is decoded. What kind the file is, its own bytes tell, not its
    name.

    Parameters
    ----------
    path : Path
        PNG, JPEG, TIFF or BMP; 1, 8 or 16 bits, grey, palette, RGB or CMYK, with or without transparency.
    bounds : Bounds, optional
        `max_pixels` is the largest image that is decoded.
    page : int, default 1
        Page of a TIFF of several pages, counted from 1.

    Returns
    -------
    ndarray of shape (H, W), uint8
        Row 0 is the top of the sheet.

    Raises
    ------
    FileEmpty
        If the file has no bytes or the image no pixel.
    UnsupportedMedia
        If the bytes are no image of a kind that is read.
    ImageTooLarge
        If width times height is over `bounds.max_pixels`.
    PageNotFound
        If the file has fewer pages.
    FileTruncated
        If the pixels end before the header says.
    FileMalformed
        If the pixels cannot be decoded.

    Notes
    -----
    Memory is about five bytes a pixel at the peak for RGBA. Decoding is Pillow's.
    """
    bounds = bounds or Bounds()
    _check_kind(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of large images; the limit here is ours
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return _load(path, bounds, page)
        finally:
            Image.MAX_IMAGE_PIXELS = limit


def load_dpi(path: Path) -> float | None:
    """Return the resolution that the file itself states [pixels an inch], or None where it states none.

    Many programs write 72 or 96 whatever the truth: it is a hint, never the scale.
    """
    try:
        with Image.open(path, formats=_FORMATS) as image:
            stated = image.info.get("dpi")
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return None
    dpi = float(stated[0]) if stated else 0.0
    return dpi if 0.0 < dpi < 1e5 else None


def _check_kind(path: Path) -> None:
    with path.open("rb") as file:
        head = file.read(16)
    if not head:
        raise FileEmpty(f"{path.name} has no bytes; upload the drawing again.")
    if not head.startswith(_MAGIC):
        raise UnsupportedMedia(
            f"{path.name} does not begin as a PNG, JPEG, TIFF or BMP image, whatever its name says; "
            "export the drawing as one of these."
        )


def _load(path: Path, bounds: Bounds, page: int) -> NDArray[np.uint8]:
    try:
        with Image.open(path, formats=_FORMATS) as image:
            _check_page(image, page, path)
            _check_size(image, bounds, path)
            image.load()
            return _grey(image)
    except UnidentifiedImageError as error:
        raise FileTruncated(f"{path.name} ends or breaks within its header; upload it again.") from error
    except (OSError, EOFError, struct.error) as error:
        if "truncated" in str(error).lower() or isinstance(error, EOFError):
            raise FileTruncated(f"{path.name} is cut short: {error}. Upload it again.") from error
        raise FileMalformed(f"{path.name} cannot be decoded: {error}.") from error
    except (ValueError, SyntaxError, IndexError, KeyError, TypeError) as error:
        raise FileMalformed(f"{path.name} cannot be decoded: {error}.") from error


def _check_page(image: Image.Image, page: int, path: Path) -> None:
    pages = getattr(image, "n_frames", 1)
    if not 1 <= page <= pages:
        raise PageNotFound(f"{path.name} has {pages} page(s); page {page} was asked for.", pages=pages)
    if page > 1:
        image.seek(page - 1)


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


def _grey(image: Image.Image) -> NDArray[np.uint8]:
    orientation = image.getexif().get(_ORIENTATION_TAG, 1)
    if image.mode in {"I", "F"} or image.mode.startswith("I;16"):
        grey = _from_wide(image)
    elif image.mode in {"1", "L"} and "transparency" not in image.info:
        grey = np.array(image.convert("L"))
    else:
        grey = _from_colour(image)
    if orientation in range(2, 9):
        turned = Image.fromarray(grey)
        turned.getexif()[_ORIENTATION_TAG] = orientation
        grey = np.array(ImageOps.exif_transpose(turned))
    return np.ascontiguousarray(grey)


def _from_wide(image: Image.Image) -> NDArray[np.uint8]:
    wide = np.asarray(image).astype(np.float32)
    if not np.isfinite(wide).all():
        raise FileMalformed("The image holds pixel values that are not numbers.")
    top = float(wide.max(initial=0.0))
    full = 65535.0 if top > 255.0 else (255.0 if top > 1.0 else 1.0)
    return np.asarray(np.clip(wide / full, 0.0, 1.0) * 255.0).astype(np.uint8)


def _from_colour(image: Image.Image) -> NDArray[np.uint8]:
    """Return the darkest channel over white, in strips of rows so that no full float copy is made."""
    width, height = image.size
    out = np.zeros((height, width), dtype=np.uint8)
    has_alpha = image.mode in {"RGBA", "LA", "PA", "La", "RGBa"} or "transparency" in image.info
    for top in range(0, height, _STRIP_ROWS):
        bottom = min(top + _STRIP_ROWS, height)
        strip = image.crop((0, top, width, bottom))
        strip.info.update({k: v for k, v in image.info.items() if k == "transparency"})
        if has_alpha:
            rgba = np.asarray(strip.convert("RGBA"))
            alpha = rgba[..., 3].astype(np.uint16)
            dark = rgba[..., :3].min(axis=2).astype(np.uint16)
            out[top:bottom] = 255 - ((255 - dark) * alpha + 127) // 255
        else:
            out[top:bottom] = np.asarray(strip.convert("RGB")).min(axis=2)
    return out
