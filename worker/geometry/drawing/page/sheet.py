"""Strokes of a vector page drawn to pixels, so that the raster route can look at them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.linework.linework import Linework

_SHIFT = 4
_LEAST_INK = 0


@dataclass(frozen=True, eq=False)
class PageSheet:
    """Hold strokes drawn to pixels, and where the sheet lies on the page.

    Parameters
    ----------
    grey : ndarray of shape (H, W), uint8
        255 is bare paper; row 0 is the top.
    origin : tuple of float
        Lower left corner of the sheet [drawing units].
    units_per_px : float
        Size of a pixel [drawing units].
    """

    grey: NDArray[np.uint8]
    origin: tuple[float, float]
    units_per_px: float


def draw_page(
    linework: Linework, entities: NDArray[np.bool_], *, units_per_px: float, most_pixels: int
) -> PageSheet:
    """Return the chosen entities drawn in black: fills as areas, strokes as wide as their pens.

    Parameters
    ----------
    linework : Linework
        A page.
    entities : ndarray of shape (E,), bool
        Which entities are drawn; the sheet is cropped to them with a small margin.
    units_per_px : float
        Size of a pixel that is wanted [drawing units]; a larger one is taken where the sheet would have
        more than `most_pixels`.
    most_pixels : int
        Largest sheet.

    Returns
    -------
    PageSheet
        At least one pixel large.
    """
    chosen = entities[linework.entity]
    ends, entity = linework.ends[chosen], linework.entity[chosen]
    if not len(ends):
        return PageSheet(np.full((1, 1), 255, dtype=np.uint8), (0.0, 0.0), units_per_px)
    low, high = ends.reshape(-1, 2).min(axis=0), ends.reshape(-1, 2).max(axis=0)
    size = high - low
    px = max(units_per_px, float(np.sqrt(max(size.prod(), 1e-12) / most_pixels)))
    margin = 40 * px
    low = low - margin
    columns, rows = (int(np.ceil(s)) + 1 for s in (size + 2 * margin) / px)
    grey = np.full((rows, columns), 255, dtype=np.uint8)
    spots = np.rint((ends - low) / px * (1 << _SHIFT)).astype(np.int64)
    spots[..., 1] = ((rows - 1) << _SHIFT) - spots[..., 1]
    spots = spots.astype(np.int32)
    mm = linework.page_mm_per_unit
    for start, stop in _groups(entity):
        e = entity[start]
        if linework.filled[e]:
            cv2.fillPoly(grey, [np.ascontiguousarray(spots[start:stop, 0])], _LEAST_INK, cv2.LINE_AA, _SHIFT)
        else:
            wide = 0.0 if mm is None or np.isnan(linework.width[e]) else float(linework.width[e]) / mm / px
            thick = max(1, round(wide))
            cv2.polylines(grey, list(spots[start:stop]), False, _LEAST_INK, thick, cv2.LINE_AA, _SHIFT)
    return PageSheet(grey, (float(low[0]), float(low[1])), px)


def _groups(entity: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return from where to where segments belong to one entity."""
    edges = np.flatnonzero(np.diff(entity)) + 1
    starts = np.concatenate([[0], edges])
    stops = np.concatenate([edges, [len(entity)]])
    return list(zip(starts.tolist(), stops.tolist(), strict=True))
