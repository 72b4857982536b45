"""The files of a revision, derived from walls, a recipe and layers: the same inputs give the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.drawing_frame import DrawingFrame
from service.domain.errors import NoWallsFound
from service.domain.findings import Finding
from service.domain.recipe import Recipe
from service.domain.region import Region
from service.domain.report import BuildInputs, BuildReport, BuiltLayer, MapCounts
from worker.formats.for_people import write_picture, write_what_can_be
from worker.formats.occupancy import write_occupancy
from worker.formats.octree import write_octree
from worker.formats.package import write_coded, write_manifest, write_package
from worker.formats.pcd import write_pcd
from worker.formats.reading import write_json, write_walls
from worker.formats.tiles import in_tile_order, write_autoware, write_tiles
from worker.geometry.cloud.erase import cut_columns, cut_walls, from_floor_to_top
from worker.geometry.cloud.merge import PlacedLayer, compound, map_transform, place_columns, place_walls
from worker.geometry.cloud.occupancy_grid import OccupancyGrid, occupancy_grid
from worker.geometry.cloud.point_cloud import Label, PointCloud, extent_of
from worker.geometry.drawing.reading.reading import Column, Wall

Progress = Callable[[str, float], None]


def write_artifacts(  # noqa: PLR0913 - a revision has this many inputs
    directory: Path,
    *,
    walls: Sequence[Wall],
    recipe: Recipe,
    inputs: BuildInputs,
    drawing: DrawingFrame | None = None,
    columns: Sequence[Column] = (),
    layers: Sequence[PlacedLayer] = (),
    erased: Sequence[Region] = (),
    findings: Sequence[Finding] = (),
    bounds: Bounds | None = None,
    progress: Progress | None = None,
) -> list[Path]:
    """Write every artifact of a revision into `directory` and return the paths.

    Parameters
    ----------
    directory : Path
        Exists; files of the same names are overwritten.
    walls, columns : sequence
        In frame `drawing`; `recipe.map_from_drawing` takes them to frame `map`.
    recipe : Recipe
        How the cloud is built.
    inputs : BuildInputs
        What the build started from, for ``report.json``.
    drawing : DrawingFrame, optional
        Where frame `drawing` lies in the file, for ``report.json``.
    layers : sequence of PlacedLayer
        In frame `map`.
    erased : sequence of Region
        In frame `map`: taken off walls, floor and ceiling.
    findings : sequence of Finding
        Remarks of earlier steps, for ``report.json``.
    bounds : Bounds, optional
        `max_map_points` limits the cloud.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    list of Path
        ``point-cloud.pcd`` (its points tile by tile), ``tiles/<sha256>.pcd``,
        ``pointcloud_map_metadata.yaml``, ``map_projector_info.yaml``, ``occupancy-grid.pgm``,
        ``occupancy-grid.yaml``, ``walls.geojson``, ``manifest.json``, ``package.tar``, ``octree.json``,
        ``octree.bin``, ``preview.png``, ``report.json``, and the large ones once more as ``<name>.zst``. Of
        octree and preview, which no robot needs, one that cannot be made is a finding in ``report.json``.

    Raises
    ------
    NoWallsFound
        If there is no wall, or everything is erased.
    TooManyPoints
        If the cloud would exceed `bounds.max_map_points`.
    CoordinatesTooLarge
        If float32 cannot tell the voxels apart so far from the origin.
    """
    if not walls:
        raise NoWallsFound(
            "There is no wall to build a map from: look at the findings of the drawing's reading, and "
            "correct it by edits (PATCH the drawing, or --edits FILE)."
        )
    tell = progress or (lambda _stage, _share: None)
    T_map_drawing = map_transform(recipe)
    walls, columns = place_walls(walls, T_map_drawing), place_columns(columns, T_map_drawing)
    tell("point-cloud", 0.1)
    cloud = in_tile_order(
        compound(walls, columns, recipe=recipe, layers=layers, erased=erased, bounds=bounds)
    )
    gone = from_floor_to_top(erased, recipe.wall_height_m)
    cells = recipe.occupancy_resolution_m
    grid = occupancy_grid(walls, columns, layers=layers, erased=gone, resolution=cells)
    walls, columns = cut_walls(walls, gone), cut_columns(columns, gone)
    if not len(cloud):
        raise NoWallsFound("Everything is erased: there is nothing left that a map could be made of.")
    tell("files", 0.4)
    paths = _for_robots(directory, cloud, grid, walls, columns)
    tell("viewing", 0.7)
    shown, not_made = write_what_can_be(
        directory,
        {
            ("octree.bin", "octree.json"): lambda: write_octree(directory, cloud),
            ("preview.png",): lambda: write_picture(directory / "preview.png", walls, columns, cloud),
        },
    )
    paths += [*shown, directory / "report.json"]
    report = BuildReport(
        frame="map",
        inputs=inputs,
        recipe=recipe,
        drawing_origin=None if drawing is None else drawing.origin,
        T_map_drawing=None if drawing is None else drawing.T_map_drawing(recipe),
        counts=_counts(cloud, walls, columns),
        layers=_layers(layers),
        extent_m=extent_of(cloud),
        findings=[*findings, *not_made],
    )
    write_json(paths[-1], report.to_json(), indent=2)
    tell("done", 1.0)
    return paths


def _for_robots(
    directory: Path,
    cloud: PointCloud,
    grid: OccupancyGrid,
    walls: Sequence[Wall],
    columns: Sequence[Column],
) -> list[Path]:
    """Write what a robot may load, the package of it, and the large files once more, compressed."""
    pcd, geojson = directory / "point-cloud.pcd", directory / "walls.geojson"
    write_pcd(pcd, cloud)
    tiles = write_tiles(directory, cloud)
    write_walls(geojson, walls, columns, frame="map")
    image, description = write_occupancy(directory, grid)
    files = [pcd, image, description, geojson, *write_autoware(directory, tiles)]
    files += [directory / tile.path for tile in tiles]
    manifest = write_manifest(directory, files, tiles, points=len(cloud))
    package = write_package(directory, manifest, files)
    return [*files, manifest, package, *(write_coded(file) for file in (pcd, image, geojson))]


def _layers(layers: Sequence[PlacedLayer]) -> tuple[BuiltLayer, ...]:
    return tuple(
        replace(layer.told or BuiltLayer.unjudged(layer.name), points_given=len(layer.cloud))
        for layer in layers
    )


def _counts(cloud: PointCloud, walls: Sequence[Wall], columns: Sequence[Column]) -> MapCounts:
    return MapCounts(
        points=len(cloud),
        points_by_label={label.name.lower(): int((cloud.labels == label).sum()) for label in Label if label},
        walls=len(walls),
        columns=len(columns),
        wall_length_m=round(sum(w.length for w in walls), 2),
    )
