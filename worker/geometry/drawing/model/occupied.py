"""Walls of an occupancy grid: the outlines of its occupied cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from skimage import measure

from service.domain.errors import DrawingTooComplex, ImageTooLarge
from worker.geometry.drawing.model.sections import area_of, signed_area
from worker.geometry.drawing.outline.solids import Solids, read_outlines

MOST_CELLS = 40_000_000
_MOST_BODIES = 5_000
_MOST_EDGES = 600_000
_MOST_CORNERS = 30_000
_SPECK_CELLS = 3
_SMOOTH_CELLS = 0.75


@dataclass(frozen=True, eq=False)
class Occupied:
    """Hold what occupied cells were read as.

    Parameters
    ----------
    solids : Solids
        Walls and columns [m], origin at the grid's lower left corner, y up.
    specks : ndarray of shape (N, 2), float64
        Middles of bodies of fewer than three cells [m].
    """

    solids: Solids
    specks: NDArray[np.float64]


def read_occupied(occupied: NDArray[np.bool_], resolution: float) -> Occupied:
    """Return the walls of an occupancy grid.

    Everything occupied stays: a robot's map shows what is there, and cannot tell furniture from walls.

    Parameters
    ----------
    occupied : ndarray of shape (H, W), bool
        Row 0 is the top.
    resolution : float
        Edge of a cell [m].

    Raises
    ------
    ImageTooLarge
        If the occupied part of the grid has more cells than are read.
    DrawingTooComplex
        If it is all specks.
    """
    rows, columns = np.flatnonzero(occupied.any(axis=1)), np.flatnonzero(occupied.any(axis=0))
    if not len(rows):
        return Occupied(Solids((), ()), np.zeros((0, 2)))
    part = occupied[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    if part.size > MOST_CELLS:
        raise ImageTooLarge(
            f"The occupied part of the map has {part.shape[1]} x {part.shape[0]} cells; at most {MOST_CELLS} "
            "are read. Save it at a lower resolution, or cut it.",
            max_pixels=MOST_CELLS,
        )
    _check_edges(part)
    solid, specks = _without_specks(part)
    corner = np.array([columns[0], occupied.shape[0] - rows[-1] - 1], dtype=np.float64)
    rings = _rings(solid)
    placed = shapely.transform(area_of(rings), lambda xy: (xy + corner) * resolution)
    return Occupied(read_outlines([placed]), (specks + corner) * resolution)


def _check_edges(part: NDArray[np.bool_]) -> None:
    """Refuse a grid whose occupied cells have far more edges than walls have."""
    edges = int((part[1:] != part[:-1]).sum()) + int((part[:, 1:] != part[:, :-1]).sum())
    if edges > _MOST_EDGES:
        raise DrawingTooComplex(
            f"The occupied cells have {edges} edges; at most {_MOST_EDGES} are read. It is noise or a "
            "texture, or no occupancy grid."
        )


def _without_specks(part: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Return the cells without bodies of fewer than three cells, and the middles of these, y up [cells]."""
    count, labels, stats, middles = cv2.connectedComponentsWithStats(part.astype(np.uint8), connectivity=8)
    small = stats[:, cv2.CC_STAT_AREA] < _SPECK_CELLS
    small[0] = False
    if count - 1 - int(small.sum()) > _MOST_BODIES:
        raise DrawingTooComplex(
            f"The map has {count - 1} separate spots of occupied cells: it is noise, or no occupancy grid."
        )
    kept = ~small
    kept[0] = False
    return kept[labels], np.column_stack([middles[small, 0] + 0.5, part.shape[0] - middles[small, 1] - 0.5])


def _rings(solid: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Return outlines of the cells, y up [cells]: outer rings run one way round, holes the other."""
    padded = np.pad(solid, 1).astype(np.float64)
    find_contours: Any = measure.find_contours
    rings: list[NDArray[np.float64]] = []
    corners = 0
    for line in find_contours(padded, 0.5, fully_connected="high"):
        outline = shapely.LineString(np.column_stack([line[:, 1] - 0.5, solid.shape[0] - line[:, 0] + 0.5]))
        smooth = shapely.simplify(outline, _SMOOTH_CELLS, preserve_topology=False)
        ring = shapely.get_coordinates(smooth)[:-1]
        if len(ring) >= 3 and abs(signed_area(ring)) > 0.0:
            rings.append(ring)
            corners += len(ring)
        if len(rings) > _MOST_BODIES or corners > _MOST_CORNERS:
            raise DrawingTooComplex(
                f"The occupied cells have more than {_MOST_BODIES} outlines or {_MOST_CORNERS} corners: "
                "it is a texture, or no occupancy grid."
            )
    return rings
