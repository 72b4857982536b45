"""A decoded image to grey: the darkest channel over white paper, a strip of rows at a time."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from service.domain.errors import FileMalformed

_STRIP_ROWS = 256
_GreyOf = Callable[[Image.Image], NDArray[np.uint8]]


def darkest_channel(image: Image.Image) -> NDArray[np.uint8]:
    """Return a loaded image of any mode as (H, W) grey: its darkest colour channel, laid over white.

    A cyan or yellow pen is so as good as a black one. 16 bits and floats are scaled to what they reach: over
    255, 65535 is white; over 1, 255 is; else 1 is.

    Raises
    ------
    FileMalformed
        If a pixel is not a number.

    Notes
    -----
    One byte a pixel beside the image itself. A palette is turned to grey once, not pixel by pixel.
    """
    if image.mode == "L" and "transparency" not in image.info:
        return np.array(image)
    if image.mode == "P":
        return _by_table(image)
    if image.mode in {"I", "F"} or image.mode.startswith("I;16"):
        return _by_strips(image, _wide_strip(image))
    if image.mode in {"RGBA", "LA", "PA", "La", "RGBa"} or "transparency" in image.info:
        return _by_strips(image, _strip_with_alpha)
    return _by_strips(image, _grey_strip if image.mode in {"1", "L"} else _colour_strip)


def over_white(rgba: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return (H, W) grey of (H, W, 4) pixels: the darkest channel, as far as it is opaque."""
    red, green, blue, alpha = cv2.split(rgba)
    dark = cv2.min(cv2.min(red, green), blue)
    if int(alpha.min()) < 255:
        dark = cv2.bitwise_not(cv2.multiply(cv2.bitwise_not(dark), alpha, scale=1.0 / 255.0))
    return np.asarray(dark, dtype=np.uint8)


def _by_table(image: Image.Image) -> NDArray[np.uint8]:
    """Return the grey of a palette image: what each of its entries is over white."""
    entries = Image.frombytes("P", (256, 1), bytes(range(256)))
    palette = image.palette
    if palette is None:
        return _by_strips(image, _grey_strip)
    entries.putpalette(palette.getdata()[1], palette.getdata()[0].split(";")[0])
    if "transparency" in image.info:
        entries.info["transparency"] = image.info["transparency"]
    table = over_white(np.asarray(entries.convert("RGBA"), dtype=np.uint8))
    return np.asarray(cv2.LUT(np.asarray(image), table.ravel()), dtype=np.uint8)


def _by_strips(image: Image.Image, grey_of: _GreyOf) -> NDArray[np.uint8]:
    width, height = image.size
    out = np.zeros((height, width), dtype=np.uint8)
    for top in range(0, height, _STRIP_ROWS):
        bottom = min(top + _STRIP_ROWS, height)
        strip = image.crop((0, top, width, bottom))
        if "transparency" in image.info:
            strip.info["transparency"] = image.info["transparency"]
        out[top:bottom] = grey_of(strip)
    return out


def _strip_with_alpha(strip: Image.Image) -> NDArray[np.uint8]:
    return over_white(np.asarray(strip.convert("RGBA"), dtype=np.uint8))


def _grey_strip(strip: Image.Image) -> NDArray[np.uint8]:
    return np.asarray(strip.convert("L"), dtype=np.uint8)


def _colour_strip(strip: Image.Image) -> NDArray[np.uint8]:
    red, green, blue = cv2.split(np.asarray(strip.convert("RGB"), dtype=np.uint8))
    return np.asarray(cv2.min(cv2.min(red, green), blue), dtype=np.uint8)


def _wide_strip(image: Image.Image) -> _GreyOf:
    extrema = image.getextrema()
    top = float(np.max(np.asarray(extrema, dtype=np.float64)))
    full = 65535.0 if top > 255.0 else (255.0 if top > 1.0 else 1.0)

    def grey_of(strip: Image.Image) -> NDArray[np.uint8]:
        wide = np.asarray(strip).astype(np.float32)
        if not np.isfinite(wide).all():
            raise FileMalformed("The image holds pixel values that are not numbers.")
        return np.asarray(np.clip(wide / full, 0.0, 1.0) * 255.0).astype(np.uint8)

    return grey_of
