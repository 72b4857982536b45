"""Walls and layers to a 2-D occupancy grid for planners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import NoWallsFound, TooManyPoints
from service.domain.region import Region
from worker.geometry.cloud.erase import held_flat
from worker.geometry.cloud.extrude import footprint, sample_polyline
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.voxel_grid import voxel_index
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

    Occupied: wall bodies with their faces, columns, and layer points between 0.1 and 2.0 m above the floor.
    Free: what the
    walls enclose, gaps of up to two metres counted as doors. The rest is unknown: the drawing does not tell.
    In `erased` regions no wall stands any more; what it enclosed is free all the same.
    """
    points = [_body(w, resolution) for w in walls]
    points += [sample_polyline(np.vstack([c.outline, c.outline[:1]]), resolution / 2) for c in columns]
    solid = np.vstack(points)
    stands = [x.cloud.points for x in layers]
    stands = [p[(p[:, 2] > _LOWEST) & (p[:, 2] < _HIGHEST), :2] for p in stands]
    occupied = np.vstack([solid[~held_flat(solid, erased)], *stands])
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
    grid = np.full(shape, UNKNOWN, dtype=np.uint8)
    x, y = (np.arange(low[k], high[k] + 1) for k in (0, 1))
    grid[footprint(solid).at((x + 0.5) * resolution, (y + 0.5) * resolution)] = FREE
    grid[tuple((index - low).T)] = OCCUPIED
    origin = low * resolution
    return OccupancyGrid(grid.T[::-1].copy(), (float(origin[0]), float(origin[1])), resolution)


def _body(wall: Wall, resolution: float) -> NDArray[np.float64]:
    """Return samples of a wall from face to face, dense enough to leave no hole in the grid."""
    step = resolution / 2
    across = max(2, int(np.ceil(wall.thickness / step)) + 1)
    if wall.faces[0].shape != wall.faces[1].shape:
        return np.vstack([sample_polyline(f, step) for f in (wall.centre, *wall.faces)])
    share = np.linspace(0.0, 1.0, across)
    return np.vstack([sample_polyline(wall.faces[0] * (1 - s) + wall.faces[1] * s, step) for s in share])
