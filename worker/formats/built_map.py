"""Maps as placement finds them on disk: a point cloud file, or the folder that a build wrote."""

from __future__ import annotations

import json
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.errors import FileMalformed, NotFound, Rejected
from service.domain.recipe import Recipe
from worker.formats.pcd import read_pcd
from worker.formats.reading import load_walls_and_columns
from worker.formats.scan import read_map_points
from worker.geometry.cloud.point_cloud import Label
from worker.geometry.registration.target import PlacementTarget


def load_target(path: Path, bounds: Bounds | None = None) -> PlacementTarget:
    """Return the map to place scans on: exact faces from a build's folder, or the points of a file.

    Parameters
    ----------
    path : Path
        A PCD or PLY file in frame `map` [m], or a folder with ``walls.geojson``, ``report.json`` and
        ``point-cloud.pcd``, of which the layers are taken.
    bounds : Bounds, optional
        The most points to read.

    Raises
    ------
    NotFound
        If there is no such file or folder, or a file of the folder is missing.
    Rejected
        If a file cannot be read as what it is; the leaf tells why.
    """
    bounds = bounds or Bounds()
    if not path.is_dir():
        if not path.is_file():
            raise NotFound(f"There is no map {path}: give a point cloud file or the folder of a build.")
        return PlacementTarget.from_cloud(read_map_points(path, bounds).points)
    for name in ("walls.geojson", "report.json", "point-cloud.pcd"):
        if not (path / name).is_file():
            raise NotFound(f"{path} holds no {name}: it is not a folder that a build wrote.")
    walls, columns = load_walls_and_columns(path / "walls.geojson", bounds=bounds)
    recipe = _recipe(path / "report.json")
    cloud = read_pcd(path / "point-cloud.pcd", bounds)
    return PlacementTarget.from_faces(
        walls, columns, wall_height=recipe.wall_height_m, ceiling=recipe.ceiling,
        layers=cloud.points[cloud.labels == Label.LAYER],
    )  # fmt: skip


def _recipe(path: Path) -> Recipe:
    """Return the recipe that a build's report names."""
    try:
        return Recipe.from_json(json.loads(path.read_text(encoding="utf-8"))["recipe"])
    except Rejected:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise FileMalformed(f"{path.name} is not the report of a build: it names no recipe.") from error
