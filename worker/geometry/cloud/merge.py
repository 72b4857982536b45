"""Walls, planes and placed scans compounded into one map (paper, sections 2.2 and 2.3, step 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from service.domain.bounds import Bounds
from service.domain.recipe import Recipe
from service.domain.region import Region
from service.domain.report import BuiltLayer
from service.domain.transform import Transform
from worker.geometry.cloud.erase import without
from worker.geometry.cloud.extrude import check_size, extrude, planes, wall_columns
from worker.geometry.cloud.point_cloud import Label, PointCloud, joined
from worker.geometry.cloud.voxel_grid import filter_cloud
from worker.geometry.drawing.reading.reading import Column, Wall


@dataclass(frozen=True, eq=False)
class PlacedLayer:
    """Hold a scan that was placed: its name in the revision, and its included part in frame `map`.

    `told` is what a report says of it beside the count of its points.
    """

    name: str
    cloud: PointCloud
    told: BuiltLayer | None = None


def map_transform(recipe: Recipe) -> Transform:
    """Return `T_map_drawing` of a recipe."""
    pose = recipe.map_from_drawing
    return Transform.from_xyz_yaw(pose.x_m, pose.y_m, 0.0, pose.yaw_rad)


def place_walls(walls: Sequence[Wall], T_map_drawing: Transform) -> tuple[Wall, ...]:
    """Return walls given in frame `drawing` in frame `map`."""
    return tuple(
        Wall(
            _flat(w.centre, T_map_drawing),
            w.thickness,
            (_flat(w.faces[0], T_map_drawing), _flat(w.faces[1], T_map_drawing)),
            w.kind,
        )
        for w in walls
    )


def place_columns(columns: Sequence[Column], T_map_drawing: Transform) -> tuple[Column, ...]:
    """Return columns given in frame `drawing` in frame `map`."""
    return tuple(Column(_flat(c.outline, T_map_drawing), c.kind) for c in columns)


def compound(
    walls: Sequence[Wall],
    columns: Sequence[Column] = (),
    *,
    recipe: Recipe,
    layers: Sequence[PlacedLayer] = (),
    erased: Sequence[Region] = (),
    bounds: Bounds | None = None,
) -> PointCloud:
    """Return the map's point cloud: walls, then ceiling, then floor, then each layer in its order.

    The drawing's part (walls and planes) is filtered at `recipe.voxel_size_m`, each layer by itself at
    `recipe.layer_voxel_size_m`: a tablet's scan stays dense whatever the drawing's voxel size.

    Parameters
    ----------
    walls, columns : sequence
        In frame `map`.
    recipe : Recipe
        Voxel sizes, wall height, floor and ceiling; its `map_from_drawing` is not applied here.
    layers : sequence of PlacedLayer
        In frame `map`.
    erased : sequence of Region
        Taken off walls, floor and ceiling; layers come as they are.
    bounds : Bounds, optional
        `max_map_points` is the most that is made.

    Returns
    -------
    PointCloud
        Every coordinate is exact in float32.

    Raises
    ------
    TooManyPoints
        If the map would exceed `bounds.max_map_points`.
    CoordinatesTooLarge
        If float32 cannot tell the voxels apart so far from the origin.
    """
    bounds = bounds or Bounds()
    size, height = recipe.voxel_size_m, recipe.wall_height_m
    xy = wall_columns(walls, columns, size)
    check_size(xy, wall_height=height, voxel_size=size, max_points=bounds.max_map_points)
    parts = [extrude(xy, wall_height=height, voxel_size=size)]
    parts += planes(
        xy,
        wall_height=height,
        voxel_size=size,
        floor=recipe.floor,
        ceiling=recipe.ceiling,
        max_points=bounds.max_map_points,
    )
    parts = [without(part, erased) for part in parts]
    parts += [filter_cloud(x.cloud, recipe.layer_voxel_size_m, label=Label.LAYER) for x in layers]
    return joined(parts)


def _flat(line: np.ndarray, T: Transform) -> np.ndarray:
    return T.apply(np.column_stack([line, np.zeros(len(line))]))[:, :2]
