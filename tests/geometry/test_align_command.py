"""`groundplan align` and `groundplan merge` on real and on generated input."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from service.domain.layer_part import TARGET
from service.domain.recipe import Recipe
from service.domain.transform import Transform
from tests.geometry.rooms import HEIGHT, a_case, box, off, walls
from worker.cli import main
from worker.formats.artifacts import write_artifacts
from worker.formats.built_map import load_target
from worker.formats.pcd import read_pcd, write_pcd
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.cloud.voxel_grid import voxel_grid_filter
from worker.geometry.registration.ndt import LEVELLED, register_ndt
from worker.geometry.registration.ndt_map import build_ndt_map

SCANS = Path(__file__).resolve().parents[3] / "shared" / "data" / "scans"
ROOM_1, ROOM_2 = SCANS / "room_scan1.pcd", SCANS / "room_scan2.pcd"
GUESS = (1.79387, 0.720047, 0.0, 39.71)
TRUTH = Transform.from_xyz_rpy((1.975, 0.061, 0.032), np.deg2rad((0.0, 1.25, 40.77)))
real_rooms = pytest.mark.skipif(
    not ROOM_1.exists(), reason=f"{SCANS} is absent: it is no part of the project"
)


def words(pose: Transform) -> str:
    x, y, z = pose.translation
    return f"{x},{y},{z},{np.rad2deg(pose.rpy[2])}"


def right(T: Transform, truth: Transform, *, within: float, degrees: float) -> bool:
    apart = float(np.linalg.norm(T.translation - truth.translation))
    return apart < within and np.rad2deg(T.distance_to(truth)[1]) < degrees


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder as `groundplan build` writes it, of the generated room at 0.1 m."""
    folder = tmp_path_factory.mktemp("built")
    write_artifacts(folder, walls=walls(), recipe=Recipe(voxel_size_m=0.1, wall_height_m=HEIGHT), inputs={})
    return folder


@real_rooms
def test_the_real_room_is_placed_as_pcl_places_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    guess = ",".join(map(str, GUESS))
    out = tmp_path / "placed"
    assert main(["align", str(ROOM_2), "--map", str(ROOM_1), "--guess", guess, "-o", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result == json.loads((out / "placement.json").read_text())
    T = Transform(np.array(result["T_map_scan"]))
    assert right(T, TRUTH, within=0.05, degrees=0.5)
    assert result["verdict"] == "accepted", result["reasons"]
    scan = read_pcd(ROOM_2)
    np.testing.assert_allclose(read_pcd(out / "aligned.pcd").points, T.apply(scan.points), atol=1e-5)
    assert np.load(out / "labels.npy").shape == (len(scan),)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["placed"]


@real_rooms
def test_the_real_room_is_found_from_every_corner_of_the_rough_pose() -> None:
    target, scan = read_pcd(ROOM_1).points, voxel_grid_filter(read_pcd(ROOM_2).points, 0.2)
    maps = [build_ndt_map(target, size) for size in (2.0, 1.0)]
    for dx, dy, dz, turn in itertools.product((-0.3, 0.0, 0.3), (-0.3, 0.0, 0.3), (-0.3, 0.3), (-5.0, 5.0)):
        x, y, z, yaw = GUESS
        start = Transform.from_xyz_yaw(x + dx, y + dy, z + dz, np.deg2rad(yaw + turn))
        rough = register_ndt(scan, maps[0], initial=start, unknowns=LEVELLED, tolerance=1e-2)
        fine = register_ndt(scan, maps[1], initial=rough.T_target_source)
        assert right(fine.T_target_source, TRUTH, within=0.05, degrees=0.5), (dx, dy, dz, turn)


def test_a_scan_is_placed_on_a_built_map_and_compounded(
    tmp_path: Path, built: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = a_case(20)
    write_pcd(tmp_path / "scan.pcd", case.scan)
    out, merged = tmp_path / "placed", tmp_path / "merged.pcd"
    guess = words(off(case.truth, 0.4, -0.3, 8.0))
    argv = [
        "align",
        str(tmp_path / "scan.pcd"),
        "--map",
        str(built),
        f"--guess={guess}",
        "-o",
        str(out),
        "--json",
    ]
    assert main(argv) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["verdict"] == "accepted", result["reasons"]
    assert result["evidence"]["map_kind"] == "faces"
    assert right(Transform(np.array(result["T_map_scan"])), case.truth, within=0.01, degrees=0.15)

    base = built / "point-cloud.pcd"
    aligned, target = read_pcd(out / "aligned.pcd"), read_pcd(out / "target.pcd")
    np.testing.assert_array_equal(target.points, aligned.points[np.load(out / "labels.npy") == TARGET])
    assert main(["merge", str(base), str(out / "target.pcd"), "--voxel-size", "0.1", "-o", str(merged)]) == 0
    cloud, before = read_pcd(merged), read_pcd(base)
    layer = cloud.points[cloud.labels == Label.LAYER]
    voxels = np.floor(layer / 0.05).astype(np.int64)
    assert len(np.unique(voxels, axis=0)) == len(layer)
    np.testing.assert_array_equal(cloud.points[: len(before)], before.points)
    np.testing.assert_array_equal(cloud.labels[: len(before)], before.labels)
    on_box = box(20)
    on_box = on_box[on_box[:, 2] > 0.15]  # where it meets the floor it is the floor's
    nearest = np.abs(layer[:, None, :] - on_box[None, ::50]).max(axis=2).min(axis=0)
    assert nearest.max() < 0.06


def test_the_same_command_twice_gives_the_same_bytes(tmp_path: Path, built: Path) -> None:
    case = a_case(21)
    write_pcd(tmp_path / "scan.pcd", case.scan)
    guess = words(off(case.truth, 0.2, 0.2, -5.0))
    for name in ("a", "b"):
        argv = ["align", str(tmp_path / "scan.pcd"), "--map", str(built), f"--guess={guess}"]
        assert main([*argv, "-o", str(tmp_path / name)]) == 0
    for file in ("placement.json", "aligned.pcd", "target.pcd", "labels.npy"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_layers_already_there_are_part_of_the_target(tmp_path: Path) -> None:
    layer = PlacedLayer("box", PointCloud.of(box(1)))
    write_artifacts(tmp_path, walls=walls(), recipe=Recipe(voxel_size_m=0.1), inputs={}, layers=[layer])
    target = load_target(tmp_path)
    assert target.kind == "faces"
    assert len(target.points) > 100
    assert np.abs(target.points - [2.0, 2.5, 0.5]).max() < 0.6


@pytest.mark.parametrize(
    ("change", "words_in_answer"),
    [
        (["--guess", "1,2,3"], "four numbers"),
        (["--guess", "1,2,nan,3"], "finite"),
        (["--guess", "0,0,0,0", "--ndt-resolution", "0"], "between"),
        (["--guess", "0,0,0,0", "--map", "/nowhere.pcd"], "no map"),
        (["--guess", "0,0,0,0", "--map", "/"], "walls.geojson"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, built: Path, capsys: pytest.CaptureFixture[str], change: list[str], words_in_answer: str
) -> None:
    write_pcd(tmp_path / "scan.pcd", PointCloud.of(np.zeros((3, 3))))
    out = tmp_path / "placed"
    argv = ["align", str(tmp_path / "scan.pcd"), "-o", str(out), *change]
    assert main(argv if "--map" in change else [*argv, "--map", str(built)]) == 1
    said = capsys.readouterr()
    assert words_in_answer in said.err.splitlines()[-1]
    assert said.out == ""
    assert not out.exists()


def test_a_missing_scan_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["align", "/nowhere.ply", "--map", "/", "--guess", "0,0,0,0", "-o", str(tmp_path / "o")]) == 1
    assert "no scan /nowhere.ply" in capsys.readouterr().err
