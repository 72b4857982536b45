"""Walls stacked to the wall height, floor and ceiling (paper, sections 2.2, step 3, and 4.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from service.domain.errors import TooManyPoints
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.cloud.voxel_grid import inside_voxels, voxel_grid_filter, voxel_index
from worker.geometry.drawing.reading.reading import Column, Wall

_JITTER = 0.01
_SAMPLES_A_VOXEL = 8
_LEVEL_SLACK = 1.001
_MIN_STEP = 0.002
_FOOTPRINT_CELL, _FOOTPRINT_CELLS = 0.1, 4e6
_CELLS_A_POINT = 4.0

DOOR_HALF_WIDTH = 1.0
"""Half the widest gap in a wall that counts as a door, so that what lies behind is a room [m]."""


def wall_columns(walls: Sequence[Wall], columns: Sequence[Column], voxel_size: float) -> NDArray[np.float64]:
    """Return the 2-D map: (M, 2) points [m] on the walls' faces, one a square cell of edge `voxel_size`.

    A LiDAR sees faces, not centre lines: both faces of each wall are sampled, finely, and in each cell the
    sample
    nearest to its centre stays. So every point lies on a face, also where a cell holds both faces of a wall.
    """
    step = max(voxel_size / _SAMPLES_A_VOXEL, _MIN_STEP)
    lines = [face for wall in walls for face in wall.faces]
    lines += [np.vstack([c.outline, c.outline[:1]]) for c in columns]
    if not lines:
        return np.zeros((0, 2))
    return voxel_grid_filter(
        np.vstack([sample_polyline(line, step) for line in lines]), voxel_size, keep="nearest-to-centre"
    )


def sample_polyline(line: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return (N, 2) points on the (K, 2) line, corners included, at most `step` apart [m]."""
    length = np.hypot(*np.diff(line, axis=0).T)
    pieces = [line[:1]]
    for a, b, d in zip(line[:-1], line[1:], length, strict=True):
        n = max(1, math.ceil(d / step))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    return np.vstack(pieces)


def levels(wall_height: float, voxel_size: float) -> NDArray[np.float64]:
    """Return the heights [m] of a stack: exactly 0 to exactly `wall_height`, evenly.

    The spacing is the smallest one above the voxel's edge, so two levels never share a voxel, whichever way
    a reader rounds a level that falls on a border. A wall lower than a voxel has the two levels all the same.
    """
    n = max(1, math.floor(wall_height / (_LEVEL_SLACK * voxel_size)))
    return np.linspace(0.0, wall_height, n + 1)


def extrude(xy: NDArray[np.float64], *, wall_height: float, voxel_size: float) -> PointCloud:
    """Return the 2-D map stacked to the wall height, labelled `Label.WALL`.

    Each point is moved by up to 1 cm within its own voxel, horizontally, by a hash of its voxel: perfectly
    flat walls have a singular covariance and are dropped by PCL >= 1.12's NDT. The same input gives the same
    points.

    Parameters
    ----------
    xy : ndarray of shape (M, 2), float64
        One point a cell, in frame `map` [m].
    wall_height, voxel_size : float
        [m].

    Returns
    -------
    PointCloud
        min z is 0 and max z is `wall_height` to float32; no voxel holds two points.
    """
    z = levels(wall_height, voxel_size)
    cell = voxel_index(xy, voxel_size)
    if wall_height <= _LEVEL_SLACK * voxel_size:  # one voxel high: cells take turns at foot and top
        height = z[(cell.sum(axis=1) + cell.sum(axis=1).min(initial=0)) % 2]
        points = np.column_stack([xy, height])
        cells = cell
        level = np.zeros(len(xy), dtype=np.int64)
    else:
        points = np.column_stack([np.repeat(xy, len(z), axis=0), np.tile(z, len(xy))])
        cells = np.repeat(cell, len(z), axis=0)
        level = np.tile(np.arange(len(z)), len(xy))
    moved = np.asarray(points[:, :2] + _jitter(cells, level, voxel_size), dtype=np.float64)
    points[:, :2] = inside_voxels(moved, cells, voxel_size)
    points[:, 2] = points[:, 2].astype(np.float32)
    return PointCloud.of(points, Label.WALL)


def planes(
    xy: NDArray[np.float64],
    *,
    wall_height: float,
    voxel_size: float,
    floor: bool,
    ceiling: bool,
    max_points: int = 50_000_000,
) -> list[PointCloud]:
    """Return floor and ceiling over the building's footprint, where no wall stands.

    One point a cell, up to 1 cm above z = 0 and below the wall height (never outside: the extent stays the
    wall
    height), by the same hash as the walls'. Where the walls are no higher than a voxel the two planes share
    cells in turn.
    """
    if not len(xy) or not (floor or ceiling):
        return []
    free = _free_cells(xy, voxel_size, max_points)
    centre = inside_voxels(np.asarray((free + 0.5) * voxel_size, dtype=np.float64), free, voxel_size)
    rise = np.abs(_jitter(free, np.full(len(free), -1), voxel_size)[:, 0])
    rise = np.minimum(rise, wall_height / 4)
    in_turn = wall_height <= _LEVEL_SLACK * voxel_size and floor and ceiling
    out = []
    for wanted, label, z, turn in (
        (ceiling, Label.CEILING, np.float32(wall_height) - rise, 1),
        (floor, Label.FLOOR, rise, 0),
    ):
        if wanted:
            mine = free.sum(axis=1) % 2 == turn if in_turn else np.full(len(free), fill_value=True)
            points = np.column_stack([centre, z])[mine]
            points[:, 2] = np.minimum(points[:, 2].astype(np.float32), np.float32(wall_height))
            out.append(PointCloud.of(points, label))
    return out


@dataclass(frozen=True, eq=False)
class Footprint:
    """Hold which square cells lie inside the building.

    Parameters
    ----------
    inside : ndarray of shape (X, Y), bool
        Indexed [ix, iy].
    corner : ndarray of shape (2,), float64
        Lower left corner of cell [0, 0] [m].
    cell : float
        Edge of a cell [m].
    """

    inside: NDArray[np.bool_]
    corner: NDArray[np.float64]
    cell: float

    def at(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return the (len(x), len(y)) answers for a lattice of positions [m]; False beyond the cells."""
        ix = np.floor((x - self.corner[0]) / self.cell).astype(np.int64)
        iy = np.floor((y - self.corner[1]) / self.cell).astype(np.int64)
        known_x, known_y = ((i >= 0) & (i < n) for i, n in zip((ix, iy), self.inside.shape, strict=True))
        out = np.zeros((len(x), len(y)), dtype=bool)
        out[np.ix_(known_x, known_y)] = self.inside[np.ix_(ix[known_x], iy[known_y])]
        return out


def footprint(xy: NDArray[np.float64]) -> Footprint:
    """Return what the walls, given as (M, 2) points [m], enclose.

    Walls are closed over gaps of up to two metres (doors), then what they enclose is filled. Rooms whose
    walls are not drawn stay outside. Cells are 10 cm, larger where that would make over four million.
    """
    area = float(np.prod(np.ptp(xy, axis=0) + 4 * DOOR_HALF_WIDTH))
    cell = max(_FOOTPRINT_CELL, math.sqrt(area / _FOOTPRINT_CELLS))
    reach = math.ceil(DOOR_HALF_WIDTH / cell)
    index = voxel_index(xy, cell)
    low = index.min(axis=0) - reach - 1
    wall = np.zeros(tuple(index.max(axis=0) - low + reach + 2), dtype=bool)
    wall[tuple((index - low).T)] = True
    near = ndimage.distance_transform_edt(~wall) <= reach
    filled = ndimage.binary_fill_holes(near)
    inside = ndimage.distance_transform_edt(filled) > reach
    return Footprint(np.asarray(inside | wall, dtype=np.bool_), low * cell, cell)


def check_size(xy: NDArray[np.float64], *, wall_height: float, voxel_size: float, max_points: int) -> None:
    """Refuse a map of more points than `max_points`, before it is made.

    Raises
    ------
    TooManyPoints
        With the number that the map would have.
    """
    count = len(xy) * len(levels(wall_height, voxel_size))
    if count > max_points:
        raise TooManyPoints(
            f"With voxels of {voxel_size} m the map would have {count} points; "
            f"at most {max_points} are made. Choose a larger voxel size.",
            max_points=max_points,
        )


def _free_cells(xy: NDArray[np.float64], voxel_size: float, max_points: int) -> NDArray[np.int64]:
    index = voxel_index(xy, voxel_size)
    low, high = index.min(axis=0), index.max(axis=0)
    if float(np.prod((high - low + 1).astype(np.float64))) > _CELLS_A_POINT * max_points:
        raise TooManyPoints(
            f"With voxels of {voxel_size} m floor and ceiling are too many points; "
            f"at most {max_points} are made. Choose a larger voxel size.",
            max_points=max_points,
        )
    x, y = (np.arange(low[k], high[k] + 1) for k in (0, 1))
    free = footprint(xy).at((x + 0.5) * voxel_size, (y + 0.5) * voxel_size)
    free[tuple((index - low).T)] = False
    return np.asarray(np.argwhere(free) + low, dtype=np.int64)


def _jitter(cell: NDArray[np.int64], level: NDArray[np.int64], voxel_size: float) -> NDArray[np.float64]:
    """Return (N, 2) offsets of at most 1 cm and a quarter voxel, by a hash of the voxel (splitmix64)."""
    with np.errstate(over="ignore"):
        h = cell[:, 0].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        h ^= cell[:, 1].astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
        h ^= level.astype(np.uint64) * np.uint64(0x165667B19E3779F9)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    u = np.column_stack([h >> np.uint64(32), h & np.uint64(0xFFFFFFFF)]).astype(np.float64) / 2**32
    return (2 * u - 1) * (min(_JITTER, voxel_size / 4) / math.sqrt(2))
