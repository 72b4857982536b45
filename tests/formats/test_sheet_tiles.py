"""A sheet's pixels in tiles: level 0 put together is the sheet, and thin lines stay in sight from afar."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from worker.formats.sheet_tiles import write_sheet_tiles

Pixels = NDArray[np.uint8]


def levels(directory: Path, grey: Pixels) -> list[Pixels]:
    """Return every level put together from its tiles, as a viewer does."""
    description, binary = write_sheet_tiles(directory, grey)
    told, content = json.loads(description.read_text()), binary.read_bytes()
    assert told["sha256"] == hashlib.sha256(content).hexdigest()
    assert told["size_px"] == [grey.shape[1], grey.shape[0]]
    shape = grey.shape
    made: list[Pixels] = []
    for _ in range(told["levels"]):
        made.append(np.full(shape, 255, dtype=np.uint8))
        shape = ((shape[0] + 1) // 2, (shape[1] + 1) // 2)
    begin = 0
    for level, column, row, size in told["tiles"]:
        tile = np.asarray(Image.open(io.BytesIO(content[begin : begin + size])))
        begin += size
        assert tile.min() < 255
        y, x = row * told["tile_px"], column * told["tile_px"]
        made[level][y : y + tile.shape[0], x : x + tile.shape[1]] = tile
    assert begin == len(content)
    return made


@pytest.mark.parametrize("shape", [(1, 1), (512, 512), (513, 1025), (700, 2111), (3001, 40)])
def test_the_first_level_is_the_sheet(tmp_path: Path, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    grey = rng.integers(0, 256, shape).astype(np.uint8)
    grey[: shape[0] // 2] = 255
    made = levels(tmp_path, grey)
    np.testing.assert_array_equal(made[0], grey)
    assert max(made[-1].shape) <= 512
    assert all(max(one.shape) > 512 for one in made[:-1])


def test_a_thin_line_stays_in_sight(tmp_path: Path) -> None:
    grey = np.full((4000, 4000), 255, dtype=np.uint8)
    grey[:, 1234] = 0
    smallest = levels(tmp_path, grey)[-1]
    assert smallest.shape == (500, 500)
    columns = np.flatnonzero((smallest < 225).all(axis=0))
    np.testing.assert_array_equal(columns, [1234 // 8])


def test_bare_paper_has_no_tiles(tmp_path: Path) -> None:
    assert all((one == 255).all() for one in levels(tmp_path, np.full((900, 900), 255, dtype=np.uint8)))
    assert (tmp_path / "sheet.bin").read_bytes() == b""
