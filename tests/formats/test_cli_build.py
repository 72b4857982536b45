"""`groundplan read` and `groundplan build` as a user calls them."""

import hashlib
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

from tests.commands import commands, documented
from worker.cli import main
from worker.formats.pcd import read_pcd
from worker.geometry.cloud.point_cloud import Label

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared"
FOR_EVER = {"up", "serve", "worker", "vda5050"}


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    """Return a drawing of 6 x 4 m at 1 cm a pixel: a room with walls of 20 cm in outline."""
    image = Image.new("RGB", (800, 600), "white")
    pen = ImageDraw.Draw(image)
    pen.rectangle([90, 90, 710, 510], outline="black", width=3)
    pen.rectangle([110, 110, 690, 490], outline="black", width=3)
    path = tmp_path / "room.png"
    image.save(path, dpi=(254, 254))
    return path


def digests(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.parametrize(
    "argument",
    [
        "--metres-per-unit=0.01",
        "--known-length=100,100,700,100,6",
        "--scale=1:100 --dpi=254",
        "--scale=1:100",
    ],
)
def test_each_way_to_give_the_scale_builds_the_same_room(sheet: Path, tmp_path: Path, argument: str) -> None:
    out = tmp_path / "map"
    assert main(["build", str(sheet), *argument.split(), "--voxel-size", "0.1", "-o", str(out)]) == 0
    points = read_pcd(out / "point-cloud.pcd").points
    assert np.allclose(points.min(axis=0), [0.9, 0.9, 0.0], atol=0.03)
    assert np.allclose(points.max(axis=0), [7.1, 5.1, 2.5], atol=0.03)


def test_the_same_command_twice_gives_the_same_bytes(sheet: Path, tmp_path: Path) -> None:
    folders = [tmp_path / "one", tmp_path / "two"]
    for out in folders:
        arguments = ["--metres-per-unit", "0.01", "--floor", "--ceiling", "--map-from-drawing", "3,1,45"]
        assert main(["build", str(sheet), *arguments, "-o", str(out)]) == 0
    assert digests(folders[0]) == digests(folders[1])
    assert {"point-cloud.pcd", "occupancy-grid.yaml", "package.tar"} < set(digests(folders[0]))


def test_json_goes_to_stdout_alone(sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "reading"
    assert main(["read", str(sheet), "--metres-per-unit", "0.01", "--json", "-o", str(out)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["scale"]["state"] == "given"
    assert printed["counts"]["walls"] == 4
    assert documented("read") == ["output"]
    assert printed == {"output": str(out)} | json.loads((out / "reading.json").read_text())
    assert sorted(digests(out)) == ["preview.png", "reading.json", "removed.geojson", "walls.geojson"]


def test_a_map_and_what_is_put_into_it_are_told_as_json(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, merged = tmp_path / "map", tmp_path / "merged.pcd"
    assert main(["build", str(sheet), "--metres-per-unit", "0.01", "--json", "-o", str(out)]) == 0
    assert documented("build") == ["output"]
    told = json.loads(capsys.readouterr().out)
    assert told == {"output": str(out)} | json.loads((out / "report.json").read_text())
    cloud = str(out / "point-cloud.pcd")
    assert main(["merge", cloud, cloud, "--voxel-size", "0.4", "-o", str(merged), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told) == documented("merge")
    labels = read_pcd(merged).labels
    assert told == {"points": len(labels), "points_of_layers": int((labels == Label.LAYER).sum())}
    assert told["points_of_layers"] > 0


def test_every_command_tells_its_result_as_json_or_runs_for_ever() -> None:
    offered = subprocess.run(
        [sys.executable, "-m", "worker.cli", "--help"], capture_output=True, text=True, check=True, cwd=ROOT
    ).stdout
    named = {words.split()[0] for words in commands()}
    assert named == {line.split()[0] for line in offered.splitlines() if re.match(r" {4}[a-z0-9]", line)}
    for words in commands():
        help_ = subprocess.run(
            [sys.executable, "-m", "worker.cli", *words.split(), "--help"],
            capture_output=True, text=True, check=True, cwd=ROOT,
        )  # fmt: skip
        assert ("--json" in help_.stdout) == (words not in FOR_EVER), words


def test_read_without_a_scale_says_so_in_pixels(sheet: Path, tmp_path: Path) -> None:
    assert main(["read", str(sheet), "-o", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "reading.json").read_text())
    assert (summary["scale"]["state"], summary["unit"]) == ("unknown", "px")


@pytest.mark.parametrize(
    ("argument", "slug"),
    [
        ("", "scale-unknown"),
        ("--metres-per-unit=-1", "invalid-request"),
        ("--metres-per-unit=nan", "invalid-request"),
        ("--known-length=1,1,1,1,5", "invalid-request"),
        ("--known-length=1,2,3", "invalid-request"),
        ("--scale=big --dpi=300", "invalid-request"),
        ("--metres-per-unit=0.01 --scale=1:100 --dpi=254", "invalid-request"),
        ("--metres-per-unit=0.01 --voxel-size=0", "invalid-request"),
        ("--metres-per-unit=0.01 --map-from-drawing=1,2", "invalid-request"),
        ("--metres-per-unit=0.01 --page=2", "page-not-found"),
        ("--metres-per-unit=0.00001", "no-walls-found"),
    ],
)
def test_a_wrong_request_is_one_line_and_leaves_nothing_behind(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], argument: str, slug: str
) -> None:
    assert main(["build", str(sheet), *argument.split(), "-o", str(tmp_path / "map")]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines()[-1].lstrip("\r").find(f"groundplan build: {slug}: ") >= 0
    assert [p.name for p in tmp_path.iterdir()] == ["room.png"]


@pytest.mark.parametrize(
    ("content", "slug"),
    [(b"", "file-empty"), (b"no drawing", "unsupported-media"), (None, "not-found")],
)
def test_a_bad_file_is_one_line_in_a_process_of_its_own(
    tmp_path: Path, content: bytes | None, slug: str
) -> None:
    path = tmp_path / "bad.png"
    if content is not None:
        path.write_bytes(content)
    command = [sys.executable, "-m", "worker.cli", "build", str(path), "--metres-per-unit=0.01"]
    done = subprocess.run(
        [*command, "-o", str(tmp_path / "map")], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 1
    assert f"groundplan build: {slug}: " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not SHARED.is_dir(), reason="the real drawings (../shared/data) are not on this machine")
def test_the_scanned_office_plan_scores_as_asked(tmp_path: Path) -> None:
    drawing, truth = (SHARED / "data/drawings" / f"rmf_office{end}" for end in (".png", ".truth.json"))
    known = ",".join(map(str, json.loads(truth.read_text())["known_length_px"]))
    arguments = ["--known-length", known, "--voxel-size", "0.1", "-o", str(tmp_path / "map")]
    assert main(["build", str(drawing), *arguments]) == 0
    score = [sys.executable, str(SHARED / "bench/score_walls.py"), str(truth)]
    said = subprocess.run(
        [*score, str(tmp_path / "map/walls.geojson"), "--image", str(drawing), "--json"],
        capture_output=True,
        text=True,
        check=True,
    )
    numbers = json.loads(said.stdout)
    assert numbers["recall@0.3"] >= 0.95
    assert numbers["f1@0.2"] >= 0.80
