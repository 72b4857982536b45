"""Images of occupancy grids (PGM, PNG, BMP) to shades, and a bare PGM as a sheet."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, FileTruncated, ImageTooLarge, UnsupportedMedia
from service.domain.findings import Finding
from worker.geometry.drawing.raster.sheet import Sheet

_FORMATS = ("PNG", "PPM", "BMP")
_UNKNOWN, _FREE = (205, 206), (254, 255)
_GRID_SHARE = 0.98


def load_pgm(path: Path, *, bounds: Bounds | None = None) -> Sheet:
    """Return a bare PGM image (P2 or P5) as a sheet.

    Where nearly all its pixels have the shades that `map_server` writes, it is an occupancy grid without its
    YAML: unknown cells become bare paper, and a finding says what it is.

    Parameters
    ----------
    path : Path
        The image.
    bounds : Bounds, optional
        The most that is read.

    Raises
    ------
    FileEmpty, FileTruncated, FileMalformed, UnsupportedMedia
        If it cannot be decoded.
    ImageTooLarge
        If it has more pixels than are read.
    """
    bounds = bounds or Bounds()
    size = path.stat().st_size
    if size > bounds.max_zip_bytes:
        raise ImageTooLarge(
            f"{path.name} has {size} bytes; at most {bounds.max_zip_bytes} are read.",
            max_bytes=bounds.max_zip_bytes,
        )
    shade, _ = decode_shades(path.read_bytes(), path.name, bounds=bounds)
    grey = np.rint(shade * 255.0).astype(np.uint8)
    unknown = np.isin(grey, _UNKNOWN)
    share = float((unknown | np.isin(grey, _FREE) | (grey == 0)).mean())
    if share < _GRID_SHARE or not unknown.any():
        return Sheet(grey)
    grey[unknown] = 255
    return Sheet(grey, findings=(_robot_map(),))


def decode_shades(
    image: bytes, name: str, *, bounds: Bounds
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the mean of the colours, 0 (black) to 1, and which pixels are transparent, both (H, W).

    Parameters
    ----------
    image : bytes
        PGM, PNG or BMP.
    name : str
        What it is called in a sentence.
    bounds : Bounds
        A quarter of its pixels are read: a cell takes more memory than a pixel of a sheet.

    Raises
    ------
    FileEmpty, FileTruncated, FileMalformed, UnsupportedMedia
        If it cannot be decoded.
    ImageTooLarge
        If it has more pixels than are read.
    """
    if not image:
        raise FileEmpty(f"{name} has no bytes.")
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(io.BytesIO(image), formats=_FORMATS) as opened:
            _check_size(opened.size, name, bounds.max_pixels // 4)
            opened.load()
            return _mean_colour(opened)
    except UnidentifiedImageError as error:
        raise UnsupportedMedia(f"{name} is no PGM, PNG or BMP image.") from error
    except (OSError, EOFError, ValueError, SyntaxError) as error:
        said = str(error).lower()
        if isinstance(error, EOFError) or any(
            word in said for word in ("truncated", "not enough", "end of file")
        ):
            raise FileTruncated(f"{name} is cut short: {error}.") from error
        raise FileMalformed(f"{name} cannot be decoded: {error}.") from error
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _check_size(size: tuple[int, int], name: str, most: int) -> None:
    width, height = size
    if width < 1 or height < 1:
        raise FileEmpty(f"{name} has no pixels.")
    if width * height > most:
        raise ImageTooLarge(
            f"{name} has {width} x {height} cells; at most {most} are read.",
            max_pixels=most,
            width=width,
            height=height,
        )


def _mean_colour(image: Image.Image) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    if image.mode in {"I", "F"} or image.mode.startswith("I;16"):
        wide = np.asarray(image).astype(np.float32)
        return wide / np.float32(65535.0), np.zeros(wide.shape, dtype=bool)
    if image.mode in {"1", "L"}:
        grey = np.asarray(image.convert("L"))
        return grey.astype(np.float32) / np.float32(255.0), np.zeros(grey.shape, dtype=bool)
    rgba = np.asarray(image.convert("RGBA"))
    shade = rgba[..., :3].mean(axis=2, dtype=np.float32) / np.float32(255.0)
    return shade.astype(np.float32), np.asarray(rgba[..., 3] == 0, dtype=np.bool_)


def _robot_map() -> Finding:
    return Finding(
        "robot-map",
        "warning",
        "This is a robot's scan map and not a design drawing: it shows what stood there when the robot "
        "passed. "
        "Its resolution stands in the map.yaml beside it: send a ZIP of both, or give metres per pixel.",
    )
