"""Bad paper: a sheet that was scanned askew, shaded, speckled or blurred gives the ink of the clean one."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from worker.geometry.drawing.raster.ink import Ink, drop_dust, find_ink
from worker.geometry.drawing.raster.skew import Level, find_skew
from worker.geometry.drawing.raster.speckle import is_blurred, is_speckled, mended, sharpened, without_specks
from worker.geometry.drawing.raster.strokes import find_strokes

M = 0.01
WALLS = ((100, 100, 900, 100), (100, 100, 100, 600), (900, 100, 900, 600), (100, 600, 900, 600))


def plan() -> NDArray[np.uint8]:
    sheet = np.full((700, 1000), 255, dtype=np.uint8)
    for x0, y0, x1, y1 in (*WALLS, (400, 100, 400, 600), (100, 350, 900, 350)):
        cv2.line(sheet, (x0, y0), (x1, y1), 0, 3)
    for k in range(20):
        cv2.putText(sheet, "ROOM 12", (120 + 190 * (k % 4), 140 + 90 * (k // 4)), 0, 0.5, 0, 1)
    return sheet


def turned(sheet: NDArray[np.uint8], degrees: float) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return the sheet turned about its middle, and the 2 x 3 matrix that its pixels went through."""
    height, width = sheet.shape
    matrix = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1.0)
    out = cv2.warpAffine(sheet, matrix, (width, height), flags=cv2.INTER_LINEAR, borderValue=(255,))
    return np.asarray(out, dtype=np.uint8), np.asarray(matrix, dtype=np.float64)


def shaded(sheet: NDArray[np.uint8]) -> NDArray[np.uint8]:
    x = np.linspace(0, 1, sheet.shape[1])[None]
    y = np.linspace(0, 1, sheet.shape[0])[:, None]
    return np.asarray(sheet * (0.55 + 0.45 * x * (1 - 0.4 * y)), dtype=np.uint8)


def speckled(sheet: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    out, dust = sheet.copy(), rng.random(sheet.shape)
    out[dust < 0.003], out[dust > 0.997] = 0, 255
    return np.clip(out + rng.normal(0, 10, sheet.shape), 0, 255).astype(np.uint8)


def agreement(one: NDArray[np.bool_], two: NDArray[np.bool_]) -> float:
    """Return the smaller share of either mask that lies within a pixel of the other."""
    kernel = np.ones((3, 3), np.uint8)
    wide = [cv2.dilate(m.astype(np.uint8), kernel) > 0 for m in (one, two)]
    return float(min(wide[1][one].mean(), wide[0][two].mean()))


@pytest.mark.parametrize("degrees", [-7.0, -3.0, -0.8, 0.0, 0.5, 2.2, 9.0])
def test_the_skew_of_a_sheet_is_found(degrees: float) -> None:
    sheet, _ = turned(plan(), degrees)
    assert math.degrees(find_skew(sheet < 128)) == pytest.approx(-degrees, abs=0.06)


def test_ink_without_direction_has_no_skew(rng: np.random.Generator) -> None:
    assert find_skew(rng.random((400, 500)) < 0.05) == 0.0
    assert find_skew(np.zeros((40, 50), dtype=np.bool_)) == 0.0


@pytest.mark.parametrize("degrees", [-6.0, 3.0])
def test_a_levelled_sheet_is_told_in_the_frame_that_was_uploaded(degrees: float) -> None:
    sheet, matrix = turned(plan(), degrees)
    ink = find_ink(sheet, M)
    assert ink.level is not None
    strokes = find_strokes(ink, ink.mask)
    long = strokes.ends[strokes.length > 250]
    slope = np.degrees(np.arctan2(*(long[:, 1] - long[:, 0]).T[::-1])) % 90
    assert np.minimum(slope, 90 - slope).max() <= 0.3
    drawn = np.stack([ink.to_drawing(ends) for ends in long])
    for x0, y0, x1, y1 in WALLS:
        corner = np.array([[x0, y0], [x1, y1]]) @ matrix[:, :2].T + matrix[:, 2]
        wanted = np.column_stack([corner[:, 0] + 0.5, sheet.shape[0] - corner[:, 1] - 0.5]) * M
        off = np.minimum(
            np.abs(drawn - wanted).max(axis=(1, 2)), np.abs(drawn[:, ::-1] - wanted).max(axis=(1, 2))
        )
        assert off.min() <= 0.06


def test_a_level_sheet_is_not_touched() -> None:
    ink = find_ink(plan(), M)
    assert ink.level is None
    assert ink.to_drawing(np.array([[-0.5, -0.5], [999.5, 699.5]])) == pytest.approx(
        np.array([[0.0, 7.0], [10.0, 0.0]])
    )


def test_the_levelled_frame_holds_the_whole_sheet() -> None:
    level = Level.of((700, 1000), math.radians(5.0))
    corners = np.array([[0.0, 0.0], [level.columns, 0], [level.columns, level.rows], [0, level.rows]])
    on_sheet = level.to_sheet(corners)
    assert cv2.contourArea(on_sheet.astype(np.float32)) == pytest.approx(level.columns * level.rows, rel=1e-3)
    for x, y in ((0, 0), (1000, 0), (1000, 700), (0, 700)):
        assert cv2.pointPolygonTest(on_sheet.astype(np.float32), (x, y), measureDist=True) >= -0.1


@pytest.mark.parametrize("reduction", [1, 3])
def test_shade_changes_no_ink(reduction: int) -> None:
    metres_per_px = M / reduction
    clean, dim = (find_ink(s, metres_per_px) for s in (plan(), shaded(plan())))
    assert clean.reduction == reduction
    assert agreement(clean.mask, dim.mask) >= 0.999
    both = clean.mask & dim.mask
    assert np.median(np.abs(clean.contrast[both].astype(int) - dim.contrast[both])) <= 6


def test_specks_are_found_and_taken_out_and_thin_lines_stay(rng: np.random.Generator) -> None:
    clean, dirty = plan(), speckled(plan(), rng)
    assert is_speckled(dirty)
    assert not is_speckled(clean)
    inks = [drop_dust(find_ink(s, M))[0] for s in (clean, dirty)]
    assert agreement(inks[0].mask, inks[1].mask) >= 0.98
    line = np.full((50, 60), 255, dtype=np.uint8)
    line[25] = line[:20, 30] = 0
    assert np.array_equal(without_specks(line, fill=True), line)


def test_a_light_speck_in_a_thin_line_is_closed_only_where_wanted() -> None:
    line = np.full((9, 60), 255, dtype=np.uint8)
    line[4] = 0
    cut = line.copy()
    cut[4, 30] = 255
    assert np.array_equal(without_specks(cut, fill=True), line)
    assert np.array_equal(without_specks(cut, fill=False), cut)


def test_specks_go_across_the_strips_that_are_worked_on(rng: np.random.Generator) -> None:
    tall = speckled(np.full((1300, 200), 255, dtype=np.uint8), rng)
    whole = without_specks(tall, fill=True)
    assert np.array_equal(whole[480:560], without_specks(tall[460:580], fill=True)[20:100])


def test_a_blurred_sheet_is_told_and_its_lines_stay_thin() -> None:
    soft = np.asarray(cv2.GaussianBlur(plan(), (0, 0), 0.9), dtype=np.uint8)
    assert is_blurred(255 - soft)
    assert not is_blurred(255 - plan())
    clean, blurred = find_ink(plan(), M), find_ink(soft, M)
    assert blurred.mask.sum() <= 1.25 * clean.mask.sum()
    assert agreement(clean.mask, blurred.mask) >= 0.98


def test_a_sharpened_sheet_has_its_close_lines_apart_again_and_as_heavy_as_they_were() -> None:
    drawn = np.zeros((1100, 60), dtype=np.uint8)
    drawn[:, 20] = drawn[:, 22] = 200
    soft = np.asarray(cv2.GaussianBlur(drawn, (0, 0), 0.8), dtype=np.uint8)
    assert (soft[:, 21] > 0.8 * soft[:, 20]).all()
    clear = sharpened(soft)
    assert (clear[:, 21] < 0.6 * np.minimum(clear[:, 20], clear[:, 22])).all()
    assert clear.sum(dtype=int) == pytest.approx(drawn.sum(dtype=int), rel=0.04)
    assert (clear == clear[0]).all()


def test_a_light_line_that_runs_into_a_heavy_one_stays_joined_on_a_blurred_sheet() -> None:
    sheet = np.full((400, 400), 255, dtype=np.uint8)
    cv2.line(sheet, (200, 20), (200, 380), 0, 3)
    for y in range(40, 380, 40):
        cv2.line(sheet, (20, y), (380, y), 150, 1)
    blurred = np.asarray(cv2.GaussianBlur(sheet, (0, 0), 0.8), dtype=np.uint8)
    ink = find_ink(blurred, M)
    count, _ = cv2.connectedComponents(ink.mask.view(np.uint8), connectivity=8)
    assert count == 2
    assert ink.mask[100].sum() <= 5


@pytest.mark.parametrize(("degrees", "least"), [(0.0, 50), (30.0, 36), (90.0, 50)])
def test_a_line_full_of_holes_is_mended_and_specks_beside_it_fade(degrees: float, least: int) -> None:
    contrast = np.zeros((201, 201), dtype=np.uint8)
    step = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    places = np.rint(100 + step * np.arange(-90, 91)[:, None]).astype(int)
    contrast[places[:, 1], places[:, 0]] = 120
    contrast[places[::5, 1], places[::5, 0]] = 30
    contrast[20:80:20, 3] = 120
    out = mended(contrast)
    assert out[places[10:-10, 1], places[10:-10, 0]].min() >= least
    assert out[20:80:20, 3].max() <= 50


def test_a_blank_sheet_has_no_ink(rng: np.random.Generator) -> None:
    noise = np.clip(rng.normal(240, 4, (300, 400)), 0, 255).astype(np.uint8)
    for sheet in (np.full((300, 400), 255, dtype=np.uint8), noise, np.full((1, 1), 255, dtype=np.uint8)):
        ink = find_ink(sheet, M)
        assert isinstance(ink, Ink)
        assert ink.mask.mean() <= 1e-3


def test_blocks_at_the_rim_may_be_smaller() -> None:
    sheet = np.full((701, 1000), 255, dtype=np.uint8)
    sheet[698:, :] = 0
    sheet[:, 997:] = 0
    ink = find_ink(sheet, M / 3)
    assert ink.mask.shape == (234, 334)
    assert ink.mask[-1].all()
    assert ink.mask[:, -1].all()
