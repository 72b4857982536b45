"""`groundplan read` with corrections, several known lengths, and options that a kind does not have."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

from worker.cli import main


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    """Return a drawing at 1 cm a pixel: a room of 6 x 4 m in filled walls and a free bench."""
    image = Image.new("L", (800, 600), 255)
    pen = ImageDraw.Draw(image)
    pen.rectangle([90, 90, 710, 510], outline=0, width=20)
    pen.rectangle([300, 300, 420, 315], outline=0, width=2)
    path = tmp_path / "room.png"
    image.save(path)
    return path


def features(folder: Path, name: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((folder / name).read_text())["features"]
    return found


def read(sheet: Path, folder: Path, *more: str) -> dict[str, Any]:
    assert main(["read", str(sheet), *more, "-o", str(folder)]) == 0
    summary: dict[str, Any] = json.loads((folder / "reading.json").read_text())
    return summary


def test_a_sheet_without_a_wall_is_repaired_by_edits(tmp_path: Path) -> None:
    """A lone line of 40 cm is no wall, until a person draws the room around it."""
    image = Image.new("L", (800, 600), 255)
    ImageDraw.Draw(image).line([(300, 300), (340, 300)], fill=0, width=2)
    image.save(tmp_path / "sheet.png")
    summary = read(tmp_path / "sheet.png", tmp_path / "first", "--metres-per-unit=0.01")
    assert (summary["confidence"], features(tmp_path / "first", "walls.geojson")) == (0.0, [])
    assert "no-walls" in [f["code"] for f in summary["findings"]]
    room = [
        [[100, 100], [700, 100]],
        [[700, 100], [700, 500]],
        [[700, 500], [100, 500]],
        [[100, 500], [100, 100]],
    ]
    edits = [{"action": "add-wall", "line": line, "thickness_m": 0.2} for line in room]
    (tmp_path / "edits.json").write_text(json.dumps(edits))
    chosen = ["--metres-per-unit=0.01", f"--edits={tmp_path / 'edits.json'}"]
    summary = read(tmp_path / "sheet.png", tmp_path / "second", *chosen)
    assert len(features(tmp_path / "second", "walls.geojson")) == 4
    assert "no-walls" not in [f["code"] for f in summary["findings"]]
    assert main(["build", str(tmp_path / "sheet.png"), *chosen, "-o", str(tmp_path / "map")]) == 0


def test_edits_from_a_file_are_applied(sheet: Path, tmp_path: Path) -> None:
    first = read(sheet, tmp_path / "first", "--metres-per-unit=0.01")
    corrections = [
        {"action": "add-wall", "line": [[400, 110], [400, 490]], "thickness_m": 0.3},
        {"action": "erase-walls", "within": [[600, 50], [760, 50], [760, 300], [600, 300]]},
        {"action": "move", "strokes": ["s1.0_1.0_2.0_2.0"], "to": "wall"},
    ]
    for content in (corrections, {"edits": corrections}):
        (tmp_path / "edits.json").write_text(json.dumps(content))
        summary = read(
            sheet, tmp_path / "out", "--metres-per-unit=0.01", f"--edits={tmp_path / 'edits.json'}"
        )
        assert summary["counts"]["edits_applied"] == 2
        assert [f["values"]["edit"] for f in summary["findings"] if f["code"] == "edit-does-not-fit"] == [2]
        walls = features(tmp_path / "out", "walls.geojson")
        added = [w for w in walls if w["properties"]["reason"] == "added by a person"]
        assert [w["properties"]["thickness_m"] for w in added] == [0.3]
        assert np.allclose(added[0]["geometry"]["coordinates"], [[4.0, 4.9], [4.0, 1.1]])
        points = np.vstack([w["geometry"]["coordinates"] for w in walls])
        assert not ((points[:, 0] > 6.01) & (points[:, 1] > 3.01)).any()
        removed = features(tmp_path / "out", "removed.geojson")
        assert "erased by a person" in {r["properties"]["reason"] for r in removed}
    assert "edits_applied" not in first["counts"]


def test_names_are_the_same_in_every_reading_whatever_the_scale(sheet: Path, tmp_path: Path) -> None:
    names = []
    for scale in ("0.01", "0.01", "0.0105"):
        read(sheet, tmp_path / "out", f"--metres-per-unit={scale}")
        names.append(
            {
                feature["properties"]["id"]
                for name in ("walls.geojson", "removed.geojson")
                for feature in features(tmp_path / "out", name)
            }
        )
    assert names[0] == names[1]
    assert len(names[0] & names[2]) >= len(names[0]) // 2


def test_several_known_lengths_are_weighed(sheet: Path, tmp_path: Path) -> None:
    lengths = ["--known-length=100,100,700,100,6", "--known-length=100,100,100,500,4.04"]
    scale = read(sheet, tmp_path / "out", *lengths)["scale"]
    assert scale["state"] == "given"
    assert scale["metres_per_unit"] == pytest.approx((6 * 600 + 4.04 * 400) / (600**2 + 400**2))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--edits=nowhere.json"], "not-found"),
        (["--edits=EDITS"], "invalid-request: An action is one of"),
        (["--page=0"], "invalid-request: 0 is no page number"),
        (["--cut-height=-1"], "invalid-request: -1 m is no height"),
        (["--wall-layer="], "invalid-request"),
    ],
)
def test_wrong_options_are_refused_in_one_line(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    (tmp_path / "edits.json").write_text('[{"action": "paint"}]')
    given = [argument.replace("EDITS", str(tmp_path / "edits.json")) for argument in arguments]
    assert main(["read", str(sheet), *given, "-o", str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
