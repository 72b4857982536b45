"""The opening of a mask by a disc: the same by distances as by a kernel, whole or in strips."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from worker.geometry.drawing.raster import opening
from worker.geometry.drawing.raster.opening import opened


def blots(rng: np.random.Generator, shape: tuple[int, int], size: float) -> NDArray[np.bool_]:
    noise = rng.normal(size=shape).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(noise, (0, 0), size) > 0.0, dtype=np.bool_)


@pytest.mark.parametrize("diameter", [47, 61, 101])
def test_distances_and_a_kernel_agree_but_for_the_rim(rng: np.random.Generator, diameter: int) -> None:
    mask = blots(rng, (600, 500), 40.0)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (diameter, diameter))
    expected = cv2.morphologyEx(mask.view(np.uint8), cv2.MORPH_OPEN, kernel) > 0
    found = opened(mask, diameter)
    assert expected.any()
    assert not found[~mask].any()
    assert (found != expected).mean() < 0.02
    core = cv2.erode(expected.view(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert found[core].mean() > 0.99


@pytest.mark.parametrize("diameter", [opening._WIDEST_DISC, opening._WIDEST_DISC + 1])
@pytest.mark.parametrize("width", [-2, 2])
def test_a_bar_stays_where_the_disc_fits_on_either_side_of_the_switch(diameter: int, width: int) -> None:
    mask = np.zeros((300, 400), dtype=np.bool_)
    mask[100 : 100 + diameter + width, 50:350] = True
    assert opened(mask, diameter).any() == (width > 0)


def test_strips_give_what_the_whole_gives(rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    mask = blots(rng, (1500, 300), 30.0)
    whole = opened(mask, 51)
    monkeypatch.setattr(opening, "_STRIP_PX", 0)
    assert np.array_equal(opened(mask, 51), whole)


@pytest.mark.parametrize("value", [False, True])
def test_a_mask_of_one_kind_stays_as_it_is(value: bool) -> None:  # noqa: FBT001 - a parameter
    mask = np.full((100, 120), value)
    assert np.array_equal(opened(mask, 61), mask)
