"""The pixels of a sheet for viewers: ``sheet.json`` tells the tiles, ``sheet.bin`` has them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from worker.formats.reading import write_json

TILE_PX = 512
_COMPRESSION = 4
_PAPER = 255


def write_sheet_tiles(directory: Path, grey: NDArray[np.uint8]) -> list[Path]:
    """Write both files and return their paths.

    Parameters
    ----------
    directory : Path
        Exists; files of the same names are overwritten.
    grey : ndarray of shape (H, W), uint8
        The sheet; row 0 is its top.

    Notes
    -----
    Level 0 is the sheet itself, each further one has half of its pixels a side, down to one tile. A pixel of
    a level lies halfway between the mean and the darkest of its four, so that thin lines stay in sight from
    afar. Tiles are PNG, at most 512 pixels a side; one of bare paper is left out. Beside the sheet only its
    half is in memory.
    """
    binary, description = directory / "sheet.bin", directory / "sheet.json"
    tiles: list[list[int]] = []
    digest = hashlib.sha256()
    level, pixels = 0, grey
    with binary.open("wb") as sink:
        while True:
            for row in range(0, pixels.shape[0], TILE_PX):
                for column in range(0, pixels.shape[1], TILE_PX):
                    tile = pixels[row : row + TILE_PX, column : column + TILE_PX]
                    if tile.min() == _PAPER:
                        continue
                    content = _png(tile)
                    digest.update(content)
                    sink.write(content)
                    tiles.append([level, column // TILE_PX, row // TILE_PX, len(content)])
            if max(pixels.shape) <= TILE_PX:
                break
            level, pixels = level + 1, _halved(pixels)
    summary = {
        "format": "groundplan-sheet/1",
        "size_px": [grey.shape[1], grey.shape[0]],
        "tile_px": TILE_PX,
        "levels": level + 1,
        "sha256": digest.hexdigest(),
        "tiles": tiles,
    }
    write_json(description, summary)
    return [description, binary]


def _png(tile: NDArray[np.uint8]) -> bytes:
    _, content = cv2.imencode(".png", np.ascontiguousarray(tile), [cv2.IMWRITE_PNG_COMPRESSION, _COMPRESSION])
    return content.tobytes()


def _halved(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return half of the pixels a side, an odd one more where there was one."""
    height, width = pixels.shape
    half = np.full(((height + 1) // 2, (width + 1) // 2), _PAPER, dtype=np.uint8)
    for row in range(0, height, 2 * TILE_PX):
        strip = pixels[row : row + 2 * TILE_PX]
        strip = np.pad(strip, ((0, strip.shape[0] % 2), (0, width % 2)), mode="edge")
        four = np.stack([strip[i::2, j::2] for i in (0, 1) for j in (0, 1)])
        mean = four.sum(axis=0, dtype=np.uint16) // 4
        half[row // 2 : row // 2 + four.shape[1]] = ((mean + four.min(axis=0)) // 2).astype(np.uint8)
    return half
