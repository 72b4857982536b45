"""Tiles and the package of a revision, read back by code that shares nothing with what wrote them."""

from __future__ import annotations

import hashlib
import json
import subprocess
import tarfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from pypcd4 import PointCloud as PyPcd4

from service.domain.recipe import MapFromDrawing, Recipe
from worker.formats.artifacts import write_artifacts
from worker.formats.pcd import pcd_bytes
from worker.formats.tiles import in_tile_order, write_tiles
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall

RECORD = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4")])


def build(directory: Path, *, machine_x: float) -> Path:
    """Write the artifacts of a hall of 70 x 45 m on both sides of the origin, with one machine in it."""
    directory.mkdir()
    corners = np.array([[0.0, 0.0], [70.0, 0.0], [70.0, 45.0], [0.0, 45.0], [0.0, 0.0]])
    walls = [Wall.of(corners[i : i + 2], thickness=0.2) for i in range(4)]
    machine = np.random.default_rng(5).uniform(0, 2, (4000, 3)) + np.array([machine_x, 1.0, 0.0])
    recipe = Recipe(voxel_size_m=0.2, floor=True, map_from_drawing=MapFromDrawing(-33.3, -21.7, 0.1))
    layers = [PlacedLayer("press", PointCloud.of(machine))]
    write_artifacts(directory, walls=walls, recipe=recipe, layers=layers, inputs={})
    return directory


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("tiles") / "before", machine_x=5.0)


def autoware_tiles(folder: Path) -> dict[str, tuple[int, int]]:
    """Return the tiles as Autoware's loader reads its metadata."""
    metadata = yaml.safe_load((folder / "pointcloud_map_metadata.yaml").read_text())
    assert metadata.pop("x_resolution") == metadata.pop("y_resolution") == 20.0
    assert all(type(value) is int for corner in metadata.values() for value in corner)
    return {name: tuple(corner) for name, corner in metadata.items()}


def test_each_tile_holds_the_points_of_its_square_and_is_named_by_its_bytes(before: Path) -> None:
    tiles = autoware_tiles(before)
    assert {path.name for path in (before / "tiles").iterdir()} == set(tiles)
    assert len(tiles) > 8
    for name, corner in tiles.items():
        content = (before / "tiles" / name).read_bytes()
        assert name == f"{hashlib.sha256(content).hexdigest()}.pcd"
        xy = PyPcd4.from_path(before / "tiles" / name).numpy(("x", "y"))
        assert (xy >= corner).all()
        assert (xy < np.add(corner, 20)).all()
    assert yaml.safe_load((before / "map_projector_info.yaml").read_text()) == {"projector_type": "Local"}


def test_the_tiles_in_the_manifests_order_are_the_cloud_bit_for_bit(before: Path) -> None:
    manifest = json.loads((before / "manifest.json").read_text())
    assert {Path(t["path"]).name: tuple(t["corner_m"]) for t in manifest["tiles"]} == autoware_tiles(before)
    whole = (before / "point-cloud.pcd").read_bytes()
    header, _, records = whole.partition(b"DATA binary\n")
    assert f"\nPOINTS {manifest['points']}\n".encode() in header
    rebuilt = b""
    for tile in manifest["tiles"]:
        body = (before / tile["path"]).read_bytes().partition(b"DATA binary\n")[2]
        assert len(body) == tile["points"] * RECORD.itemsize
        rebuilt += body
    assert rebuilt == records


def test_what_did_not_change_keeps_its_name(before: Path, tmp_path: Path) -> None:
    after = build(tmp_path / "after", machine_x=9.0)
    old, new = set(autoware_tiles(before)), set(autoware_tiles(after))
    assert 0 < len(new - old) <= 2
    assert len(old & new) >= len(new) - 2


def test_the_package_is_the_same_twice_and_holds_what_its_manifest_tells(
    before: Path, tmp_path: Path
) -> None:
    again = build(tmp_path / "again", machine_x=5.0)
    assert (again / "package.tar").read_bytes() == (before / "package.tar").read_bytes()
    with tarfile.open(before / "package.tar", "r:") as package:
        names = package.getnames()
        assert names[0] == "manifest.json"
        told = json.load(package.extractfile("manifest.json"))["files"]  # type: ignore[arg-type]
        assert [file["path"] for file in told] == names[1:]
        for file in told:
            content = package.extractfile(file["path"]).read()  # type: ignore[union-attr]
            assert (hashlib.sha256(content).hexdigest(), len(content)) == (file["sha256"], file["size_bytes"])
    assert {"point-cloud.pcd", "occupancy-grid.pgm", "occupancy-grid.yaml", "walls.geojson"} < set(names)
    listed = subprocess.run(
        ["tar", "-tf", before / "package.tar"], capture_output=True, text=True, check=True
    )
    assert listed.stdout.split() == names


def test_the_large_files_come_compressed_as_the_zstd_program_reads_them(before: Path) -> None:
    for name in ("point-cloud.pcd", "occupancy-grid.pgm", "walls.geojson"):
        done = subprocess.run(["zstd", "-dcq", before / f"{name}.zst"], capture_output=True, check=True)
        assert done.stdout == (before / name).read_bytes()


def test_autowares_tiles_and_nav2s_grid_show_the_same_walls(before: Path) -> None:
    points = np.vstack([PyPcd4.from_path(path).numpy() for path in (before / "tiles").iterdir()])
    wall = points[(points[:, 3] == 1) & (points[:, 2] > 0.3)][:, :2]
    grid = yaml.safe_load((before / "occupancy-grid.yaml").read_text())
    header, pixels = (before / grid["image"]).read_bytes().split(b"\n255\n", 1)
    width, height = map(int, header.split()[1:3])
    occupied = np.flipud(np.frombuffer(pixels, dtype=np.uint8).reshape(height, width)) == 0
    cell = np.floor((wall - grid["origin"][:2]) / grid["resolution"]).astype(int)
    near = np.zeros_like(occupied)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            near |= np.roll(occupied, (dy, dx), axis=(0, 1))
    assert near[cell[:, 1], cell[:, 0]].all()


def test_the_order_is_by_tile_and_stable_inside(tmp_path: Path, rng: np.random.Generator) -> None:
    points = rng.uniform(-65, 65, (5000, 3)).astype(np.float32).astype(np.float64)
    points[0] = np.nextafter(np.float32(20), np.float32(0), dtype=np.float32)
    cloud = in_tile_order(PointCloud(points, np.arange(5000, dtype=np.uint32)))
    tile = np.floor(cloud.points[:, 1] / 20) * 1000 + np.floor(cloud.points[:, 0] / 20)
    assert (np.diff(tile) >= 0).all()
    same = np.diff(tile) == 0
    assert (np.diff(cloud.labels.astype(np.int64))[same] > 0).all()
    twice = in_tile_order(cloud)
    assert pcd_bytes(twice) == pcd_bytes(cloud)
    assert sum(t.points for t in write_tiles(tmp_path, cloud)) == 5000
    with pytest.raises(ValueError, match="tile by tile"):
        write_tiles(tmp_path, PointCloud(points, cloud.labels))
