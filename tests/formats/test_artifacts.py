"""The artifacts of a revision: the same bytes twice, and readers that are not ours."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from pypcd4 import PointCloud as PyPcd4

from service.domain.errors import NoWallsFound
from service.domain.findings import Finding
from service.domain.recipe import MapFromDrawing, Recipe
from worker.formats.artifacts import write_artifacts
from worker.formats.pcd import read_pcd
from worker.formats.reading import load_walls_and_columns
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Column, Wall

NAMES = [
    "manifest.json",
    "map_projector_info.yaml",
    "occupancy-grid.pgm",
    "occupancy-grid.pgm.zst",
    "occupancy-grid.yaml",
    "octree.bin",
    "octree.json",
    "package.tar",
    "point-cloud.pcd",
    "point-cloud.pcd.zst",
    "pointcloud_map_metadata.yaml",
    "preview.png",
    "report.json",
    "walls.geojson",
    "walls.geojson.zst",
]


def build(directory: Path) -> list[Path]:
    directory.mkdir()
    corners = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0], [0.0, 0.0]])
    walls = [Wall.of(corners[i : i + 2], thickness=0.2) for i in range(4)]
    scan = PointCloud.of(np.random.default_rng(5).uniform(2, 3, (4000, 3)))
    return write_artifacts(
        directory,
        walls=walls,
        columns=[Column(np.array([[5.0, 2.0], [5.4, 2.0], [5.4, 2.4], [5.0, 2.4]]))],
        recipe=Recipe(
            voxel_size_m=0.1, floor=True, ceiling=True, map_from_drawing=MapFromDrawing(1.0, 2.0, 0.3)
        ),
        layers=[PlacedLayer("press", scan)],
        inputs={"drawing": {"sha256": "0" * 64}},
        findings=[Finding("guessed", "info", "A remark.")],
    )


def test_the_same_inputs_give_the_same_bytes(tmp_path: Path) -> None:
    digests = [
        {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in build(tmp_path / name)}
        for name in ("one", "two")
    ]
    assert sorted(name for name in digests[0] if len(name) < 64) == NAMES
    assert len(digests[0]) > len(NAMES)
    assert digests[0] == digests[1]


def test_the_cloud_opens_elsewhere_with_the_same_points_and_labels(tmp_path: Path) -> None:
    build(tmp_path / "out")
    path = tmp_path / "out" / "point-cloud.pcd"
    ours = read_pcd(path)
    other = PyPcd4.from_path(path)
    assert other.fields == ("x", "y", "z", "label")
    assert np.array_equal(other.numpy(("x", "y", "z")), ours.points.astype(np.float32))
    assert np.array_equal(other.numpy(("label",))[:, 0].astype(np.uint32), ours.labels)
    open3d = pytest.importorskip("open3d", reason="Open3D needs system libraries that this machine lacks")
    tensor = open3d.t.io.read_point_cloud(str(path))
    assert np.array_equal(tensor.point["positions"].numpy(), ours.points.astype(np.float32))
    assert np.array_equal(tensor.point["label"].numpy()[:, 0].astype(np.uint32), ours.labels)


def test_the_report_counts_what_the_cloud_holds(tmp_path: Path) -> None:
    build(tmp_path / "out")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    cloud = read_pcd(tmp_path / "out" / "point-cloud.pcd")
    counted = report["counts"]["points_by_label"]
    assert [counted[k] for k in ("wall", "ceiling", "floor", "layer")] == [
        int((cloud.labels == k).sum()) for k in (1, 2, 3, 4)
    ]
    assert min(counted.values()) > 0
    assert report["counts"]["points"] == len(cloud)
    assert report["inputs"] == {"drawing": {"sha256": "0" * 64}}
    assert Recipe.from_json(report["recipe"]).map_from_drawing == MapFromDrawing(1.0, 2.0, 0.3)
    (press,) = report["layers"]
    assert (press["name"], press["points_given"], press["verdict"]) == ("press", 4000, None)
    assert (report["drawing_origin"], report["T_map_drawing"]) == (None, None)
    assert report["findings"][0]["code"] == "guessed"


def test_the_grid_is_what_map_server_reads(tmp_path: Path) -> None:
    build(tmp_path / "out")
    description = yaml.safe_load((tmp_path / "out" / "occupancy-grid.yaml").read_text())
    image = np.array(Image.open(tmp_path / "out" / description["image"]))
    assert description["negate"] == 0
    assert set(np.unique(image)) == {0, 205, 254}
    occupied = (255 - image.astype(float)) / 255
    assert ((occupied > description["occupied_thresh"]) == (image == 0)).all()
    assert ((occupied < description["free_thresh"]) == (image == 254)).all()
    x, y, yaw = description["origin"]
    (wall, *_), _ = load_walls_and_columns(tmp_path / "out" / "walls.geojson")
    middle = wall.centre.mean(axis=0)
    column = int((middle[0] - x) / description["resolution"])
    row = image.shape[0] - 1 - int((middle[1] - y) / description["resolution"])
    assert image[row, column] == 0
    assert yaw == 0.0


def test_without_walls_there_is_no_map(tmp_path: Path) -> None:
    with pytest.raises(NoWallsFound):
        write_artifacts(tmp_path, walls=[], recipe=Recipe(), inputs={})
