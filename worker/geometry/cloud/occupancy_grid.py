"""Walls and layers to a 2-D occupancy grid for planners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.errors import NoWallsFound, TooManyPoints
from service.domain.region import Region
from worker.geometry.cloud.erase import held_flat
from worker.geometry.cloud.extrude import DOOR_HALF_WIDTH, sample_polyline
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.voxel_grid import voxel_index
from worker.geometry.drawing.reading.bodies import single_lines, solid_of
from worker.geometry.drawing.reading.reading import Column, Wall

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
_BORDER_CELLS = 10
_MOST_CELLS = 2e8
_LOWEST, _HIGHEST = 0.1, 2.0


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Hold grey cells as ROS ``map_server`` saves them: 0 occupied, 205 unknown, 254 free.

    Parameters
    ----------
    cells : ndarray of shape (H, W), uint8
        Row 0 is the largest y.
    origin : tuple of float
        Lower left corner of the lower left cell in frame `map` [m].
    resolution : float
        Edge of a cell [m].
    """

    cells: NDArray[np.uint8]
    origin: tuple[float, float]
    resolution: float


def occupancy_grid(
    walls: Sequence[Wall],
    columns: Sequence[Column] = (),
    *,
    layers: Sequence[PlacedLayer] = (),
    erased: Sequence[Region] = (),
    resolution: float,
) -> OccupancyGrid:
    """Return the grid of what a robot on the floor meets, in frame `map`.

    Occupied: the cells that faces of walls and columns touch, those between the faces, also where walls meet,
    and layer points between 0.1 and 2.0 m above the floor. Free: what the walls enclose, gaps of up to two
    metres counted as doors. The rest is unknown: the drawing does not tell.
    In `erased` regions no wall stands any more; what it enclosed is free all the same.
    """
    lines = [face for w in walls for face in w.faces]
    lines += [np.vstack([c.outline, c.outline[:1]]) for c in columns]
    faces = np.vstack([sample_polyline(line, resolution / 2) for line in lines])
    stands = [x.cloud.points for x in layers]
    stands = [p[(p[:, 2] > _LOWEST) & (p[:, 2] < _HIGHEST), :2] for p in stands]
    occupied = np.vstack([faces[~held_flat(faces, erased)], *stands])
    if not len(occupied):
        raise NoWallsFound("Everything is erased: there is nothing left that a map could be made of.")
    index = voxel_index(occupied, resolution)
    low, high = index.min(axis=0) - _BORDER_CELLS, index.max(axis=0) + _BORDER_CELLS
    shape = high - low + 1
    if float(np.prod(shape.astype(np.float64))) > _MOST_CELLS:
        raise TooManyPoints(
            f"The map is {shape[0] * resolution:.0f} x {shape[1] * resolution:.0f} m: too large for an "
            f"occupancy grid of {resolution} m. Choose a coarser occupancy_resolution_m, "
            "or look for stray walls."
        )
    solid = solid_of(walls, columns)
    gone = [shapely.make_valid(shapely.Polygon(region.within)) for region in erased]
    grid = np.full(shape, UNKNOWN, dtype=np.uint8)
    grid[_cells_within(_enclosed([solid, *single_lines(walls)]), low, shape, resolution)] = FREE
    grid[_cells_within(solid.difference(shapely.union_all(gone)), low, shape, resolution)] = OCCUPIED
    grid[tuple((index - low).T)] = OCCUPIED
    origin = low * resolution
    return OccupancyGrid(grid.T[::-1].copy(), (float(origin[0]), float(origin[1])), resolution)


def _enclosed(drawn: Sequence[Any]) -> Any:
    """Return what is drawn or enclosed: all within reach of it, without holes, drawn back by the reach."""
    near = shapely.get_parts(shapely.union_all(drawn).buffer(DOOR_HALF_WIDTH))
    return shapely.union_all(shapely.polygons(shapely.get_exterior_ring(near))).buffer(-DOOR_HALF_WIDTH)


def _cells_within(
    area: Any, low: NDArray[np.int64], shape: NDArray[np.int64], resolution: float
) -> NDArray[np.bool_]:
    """Return which cells of a lattice, its lowest cell `low`, have their middles in an area [m].

    Along each line of cells every ring that is crossed leads into the area or out of it.
    """
    area = area.intersection(shapely.box(*low * resolution, *(low + shape) * resolution))
    ring, of = shapely.get_coordinates(shapely.get_rings(shapely.get_parts(area)), return_index=True)
    begin = np.flatnonzero(of[1:] == of[:-1])
    a, b = (ring[at] / resolution - 0.5 - low for at in (begin, begin + 1))
    first, last = (np.ceil(end(a[:, 1], b[:, 1])).astype(np.int64) for end in (np.minimum, np.maximum))
    count = last - first
    edge = np.repeat(np.arange(len(count)), count)
    y = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - first, count)
    x = a[edge, 0] + (y - a[edge, 1]) * (b[edge, 0] - a[edge, 0]) / (b[edge, 1] - a[edge, 1])
    turns = np.zeros((shape[0] + 1, shape[1]), dtype=np.bool_)
    np.logical_xor.at(turns, (np.ceil(x).astype(np.int64), y), True)
    return np.asarray(np.logical_xor.accumulate(turns, axis=0)[:-1], dtype=np.bool_)
