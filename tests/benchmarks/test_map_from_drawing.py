"""How well a LiDAR finds itself in a map from a drawing: our reading, the true walls, everything dark."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from service.domain.recipe import Recipe
from service.domain.scale_hint import KnownLength, ScaleHint
from tests.benchmarks.vlp16 import OFF_M, free_points, load_world, position_errors, scan, starts_off
from worker.formats.drawing import read_drawing_file
from worker.formats.raster import load_sheet
from worker.geometry.cloud.extrude import extrude, footprint, planes, wall_columns
from worker.geometry.cloud.merge import compound
from worker.geometry.cloud.voxel_grid import voxel_grid_filter
from worker.geometry.drawing.reading.reading import Column, Wall
from worker.geometry.registration.ndt_map import build_ndt_map

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1800)]

POINTS = 40
VOXEL, HEIGHT, RESOLUTION = 0.1, 2.5, 1.0
CLEARANCE = 0.35
DARK = 200
WORLD_TO_SHEET = (0.0, 14.5353)


def _cloud(walls: Sequence[Wall], columns: Sequence[Column]) -> NDArray[np.float64]:
    recipe = Recipe(voxel_size_m=VOXEL, wall_height_m=HEIGHT, floor=True)
    cloud = compound(walls, columns, recipe=recipe, layers=(), bounds=Bounds())
    return np.asarray(cloud.points, dtype=np.float64)


def _dark_cloud(grey: NDArray[np.uint8], metres_per_px: float) -> NDArray[np.float64]:
    """Return the map of everything darker than a threshold, as a wall."""
    rows, columns = np.nonzero(grey < DARK)
    xy = np.column_stack([columns + 0.5, grey.shape[0] - rows - 0.5]) * metres_per_px
    xy = voxel_grid_filter(xy, VOXEL, keep="nearest-to-centre")
    parts = [extrude(xy, wall_height=HEIGHT, voxel_size=VOXEL)]
    parts += planes(xy, wall_height=HEIGHT, voxel_size=VOXEL, floor=True, ceiling=False)
    return np.vstack([p.points for p in parts]).astype(np.float64)


def _true_walls(truth: dict[str, Any]) -> list[Wall]:
    return [Wall.of(np.array([w[:2], w[2:4]], dtype=np.float64), thickness=0.1) for w in truth["walls"]]


def test_a_lidar_finds_itself_in_the_map_of_a_drawing(shared_data: Path) -> None:
    sheet = shared_data / "drawings" / "rmf_office.png"
    truth = json.loads(sheet.with_suffix(".truth.json").read_text(encoding="utf-8"))
    hint = ScaleHint(known_length=KnownLength(*truth["known_length_px"]))
    reading = read_drawing_file(sheet, options=DrawingOptions(scale=hint))
    annotated = _true_walls(truth)
    world = load_world(shared_data / "worlds" / "rmf_office.npz", WORLD_TO_SHEET)

    rng = np.random.default_rng(20)
    outline = wall_columns(annotated, (), VOXEL)
    inside = footprint(outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    candidates = rng.uniform(low, high, (4000, 2))
    candidates = candidates[[bool(inside.at(x[:1], x[1:])[0, 0]) for x in candidates]]
    positions = free_points(world, candidates, count=POINTS, clearance=CLEARANCE)
    assert len(positions) == POINTS
    scans = [scan(world, p, every=4, rng=rng) for p in positions]
    starts = starts_off(positions, rng)

    clouds = {
        "our reading": _cloud(reading.walls, reading.columns),
        "the true walls": _cloud(annotated, ()),
        "everything dark is wall": _dark_cloud(load_sheet(sheet).grey, truth["metres_per_px"]),
    }
    print(f"\n{POINTS} VLP-16 scans in the world of {sheet.name}, started {OFF_M} m and 5 degrees off")
    results = {}
    for name, cloud in clouds.items():
        on_plan, in_height = position_errors(build_ndt_map(cloud, RESOLUTION), scans, starts, positions).T
        results[name] = on_plan
        print(
            f"{name:>24}: mean position error {on_plan.mean():.3f} m (median {np.median(on_plan):.3f}), "
            f"within 0.1 m {(on_plan <= 0.1).mean():.0%}; height {in_height.mean():.3f} m"
        )
    assert all(np.isfinite(errors).all() for errors in results.values())
    assert (results["the true walls"] <= 0.1).mean() > 0.5  # else the simulation itself is wrong
