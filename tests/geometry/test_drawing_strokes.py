"""Skeleton, branches and straight strokes: against an independent thinning, and on lines that are known."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from skimage.morphology import skeletonize

from worker.geometry.drawing.raster.ink import Ink
from worker.geometry.drawing.raster.squeeze import Squeezed
from worker.geometry.drawing.raster.strokes import Strokes, find_strokes
from worker.geometry.drawing.raster.thinning import branches, thin

M = 0.01


def blobs(seed: int, *, smooth: float) -> NDArray[np.bool_]:
    noise = np.random.default_rng(seed).random((240, 320))
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), smooth) > 0.5)


def as_ink(mask: NDArray[np.bool_]) -> Ink:
    return Ink(mask, np.where(mask, np.uint8(200), np.uint8(0)), 1, M, mask.shape[0] * M)


def drawn(*lines: tuple[tuple[int, int], tuple[int, int], int], size: int = 400) -> NDArray[np.bool_]:
    sheet = np.zeros((size, size), dtype=np.uint8)
    for start, end, width in lines:
        cv2.line(sheet, start, end, 1, width)
    return np.asarray(sheet, dtype=np.bool_)


def components(mask: NDArray[np.bool_]) -> int:
    return int(cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[0])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("smooth", [1.0, 3.0, 6.0])
def test_thinning_keeps_what_hangs_together_and_its_holes(seed: int, smooth: float) -> None:
    mask = blobs(seed, smooth=smooth)
    skeleton = thin(mask)[0][1:-1, 1:-1].astype(np.bool_)
    assert not (skeleton & ~mask).any()
    assert components(skeleton) == components(mask)
    frame = np.pad(mask, 1), np.pad(skeleton, 1)
    holes = [cv2.connectedComponents((~m).astype(np.uint8), connectivity=4)[0] for m in frame]
    assert holes[0] == holes[1]


@pytest.mark.parametrize("seed", range(3))
def test_thinning_lies_beside_that_of_another_library(seed: int) -> None:
    mask = blobs(seed, smooth=4.0)
    own = thin(mask)[0][1:-1, 1:-1]
    other = np.asarray(skeletonize(mask), dtype=np.uint8)  # type: ignore[no-untyped-call]
    for one, two in ((own, other), (other, own)):
        near = cv2.dilate(two, np.ones((5, 5), np.uint8)) > 0
        assert near[one > 0].mean() >= 0.95
    assert 0.85 <= own.sum() / other.sum() <= 1.02


def test_places_are_the_pixels_of_the_skeleton() -> None:
    image, places = thin(blobs(0, smooth=3.0))
    assert np.array_equal(np.flatnonzero(image), places)
    assert image.max() == 1


def test_an_empty_mask_has_no_branch() -> None:
    order, starts = branches(*thin(np.zeros((5, 7), dtype=np.bool_)))
    assert order.shape == (0, 2)
    assert starts.tolist() == [0]


def test_every_pixel_is_in_one_branch_or_a_junction() -> None:
    image, places = thin(drawn(((50, 200), (350, 200), 5), ((200, 50), (200, 350), 5)))
    order, starts = branches(image, places)
    assert len(np.unique(order, axis=0)) == len(order)
    assert len(places) - len(order) <= 20
    assert sorted(np.diff(starts).tolist())[-4:] == pytest.approx([147] * 4, abs=6)


@pytest.mark.parametrize("degrees", [0, 3, 17, 30, 45, 71, 90])
@pytest.mark.parametrize("width", [1, 3, 9])
def test_a_line_is_one_stroke_with_its_ends_width_and_direction(degrees: int, width: int) -> None:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    start, end = (round(200 - 150 * c), round(200 - 150 * s)), (round(200 + 150 * c), round(200 + 150 * s))
    mask = drawn((start, end, width))
    strokes = find_strokes(as_ink(mask), mask)
    longest = int(np.argmax(strokes.length))
    tips = strokes.ends[longest]
    tips = tips if np.hypot(*(tips[0] - start)) < np.hypot(*(tips[1] - start)) else tips[::-1]
    assert np.abs(tips - np.array([start, end])).max() <= width / 2 + 3.0
    across = mask.sum() / np.hypot(*np.subtract(end, start))  # the drawing function widens what it draws
    assert strokes.width[longest] == pytest.approx(across, abs=1.3 + 0.1 * across)
    assert strokes.length.sum() - strokes.length[longest] <= 2 * width


def test_a_line_runs_on_across_a_crossing_and_a_corner_parts_it() -> None:
    mask = drawn(((20, 100), (380, 100), 3), ((200, 20), (200, 180), 3), ((20, 100), (20, 380), 3))
    strokes = find_strokes(as_ink(mask), mask)
    lengths = np.sort(strokes.length[strokes.length > 10])
    assert lengths == pytest.approx([160, 280, 360], abs=5)


def test_strokes_are_numbered_by_their_connected_part() -> None:
    mask = np.zeros((400, 400), dtype=np.bool_)
    mask[50:53, 20:380] = mask[150:153, 20:380] = True
    strokes = find_strokes(as_ink(mask), mask)
    long = strokes.length > 300
    assert set(strokes.part.tolist()) == {1, 2}
    assert sorted(strokes.part[long].tolist()) == [1, 2]
    assert strokes.weight[long] == pytest.approx([200 * 3] * 2, rel=0.05)


@pytest.mark.parametrize("seed", range(4))
def test_squeezing_changes_no_stroke(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = np.zeros((900, 1200), dtype=np.bool_)
    for _ in range(12):
        row, column = (int(rng.integers(0, most)) for most in (840, 1130))
        kind = blobs(seed, smooth=3.0)[: rng.integers(5, 60), : rng.integers(5, 60)]
        mask[row : row + kind.shape[0], column : column + kind.shape[1]] |= kind
    ink = as_ink(mask)
    whole = find_strokes(ink, mask)
    squeezed = Squeezed.of(mask)
    assert squeezed.mask.sum() == mask.sum()
    assert squeezed.mask.size < 0.7 * mask.size
    small = find_strokes(replace(ink, contrast=squeezed.taken(ink.contrast)), squeezed.mask)
    back = squeezed.in_whole(small.ends)
    one, two = (np.unique(np.round(ends.reshape(-1, 4), 6), axis=0) for ends in (back, whole.ends))
    assert np.array_equal(one, two)
    assert np.allclose(np.sort(small.width), np.sort(whole.width))
    assert np.allclose(np.sort(small.weight), np.sort(whole.weight))


def test_nothing_is_squeezed_to_a_pixel() -> None:
    assert Squeezed.of(np.zeros((50, 60), dtype=np.bool_)).mask.shape == (1, 1)


def test_no_ink_is_no_stroke() -> None:
    mask = np.zeros((50, 60), dtype=np.bool_)
    found = find_strokes(as_ink(mask), mask)
    assert isinstance(found, Strokes)
    assert len(found) == 0
