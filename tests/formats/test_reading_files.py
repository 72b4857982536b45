"""Walls as GeoJSON: the round trip, and files from outside that break the format."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, NotFinite, UnsupportedMedia
from worker.formats.reading import load_walls_and_columns, write_reading, write_walls
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall
from worker.geometry.drawing.scale.decision import Scale, given

WALL = Wall.of(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]), thickness=0.2)
PIER = Column(np.array([[1.0, 1.0], [1.4, 1.0], [1.4, 1.4], [1.0, 1.4]]))


def feature(coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": "LineString", "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def test_walls_and_columns_come_back(tmp_path: Path) -> None:
    path = tmp_path / "walls.geojson"
    write_walls(path, [WALL], [PIER], frame="map")
    (wall,), (pier,) = load_walls_and_columns(path)
    assert np.allclose(wall.centre, WALL.centre)
    assert all(np.allclose(a, b) for a, b in zip(wall.faces, WALL.faces, strict=True))
    assert (wall.thickness, wall.kind) == (0.2, "wall")
    assert np.allclose(pier.outline, PIER.outline)
    assert json.loads(path.read_text())["frame"] == "map"


def test_a_reading_is_four_files_and_names_every_removed_stroke(tmp_path: Path) -> None:
    stroke = RemovedStroke((np.array([[1.0, 1.0], [2.0, 2.0]]),), "text", "small")
    reading = Reading((WALL,), (PIER,), (stroke,), (5.0, 4.0), given(0.01), "outlined")
    paths = write_reading(reading, tmp_path)
    assert [p.name for p in paths] == ["walls.geojson", "removed.geojson", "preview.png", "reading.json"]
    removed = json.loads(paths[1].read_text())["features"]
    assert [f["properties"] for f in removed] == [
        {"id": "s100.00_100.00_200.00_200.00", "layer": "text", "reason": "small"}
    ]
    summary = json.loads(paths[3].read_text())
    assert summary["counts"] == {
        "walls": 1,
        "columns": 1,
        "wall_length_m": 7.0,
        "removed": {"text": 1},
        "removed_strokes": {"text": 1},
    }
    walls = [f["properties"] for f in json.loads(paths[0].read_text())["features"]]
    assert [(w["kind"], w["layer"]) for w in walls] == [("wall", "wall"), ("column", "column")]
    assert all(w["id"] and w["reason"] for w in walls)
    assert (summary["scale"], summary["unit"], summary["sheet"]) == (
        given(0.01).told().to_json(),
        "m",
        [5.0, 4.0],
    )


def test_a_coordinate_that_is_no_number_is_a_defect_and_is_not_written(tmp_path: Path) -> None:
    stroke = RemovedStroke((np.array([[1.0, 1.0], [np.nan, 2.0]]),), "text", "small")
    reading = Reading((WALL,), (), (stroke,), (5.0, 4.0), given(0.01), "outlined")
    with pytest.raises(ValueError, match="finite"):
        write_reading(reading, tmp_path)
    wide = replace(WALL, thickness=float("nan"))
    with pytest.raises(ValueError, match="finite"):
        write_walls(tmp_path / "walls.geojson", [wide], frame="map")


def test_strokes_of_several_lines_and_strange_words_come_back(tmp_path: Path) -> None:
    lines = (np.array([[0.0, -0.00001], [2.0, 2.0]]), np.array([[1.0, 5.0], [3.25, 2.0], [9.0, 1.0]]))
    strokes = tuple(RemovedStroke(lines[:n], "text", f"\ud800\x00 {n}") for n in (1, 2) for _ in range(6_000))
    reading = Reading((WALL,), (PIER,), strokes, (5.0, 4.0), given(0.01), "outlined")
    written = json.loads(write_reading(reading, tmp_path)[1].read_text())
    assert {k: v for k, v in written.items() if k != "features"} == {
        "type": "FeatureCollection",
        "frame": "drawing",
        "unit": "m",
    }
    assert [f["geometry"]["coordinates"] for f in written["features"]] == [
        [[[0.0, 0.0], [2.0, 2.0]], [[1.0, 5.0], [3.25, 2.0], [9.0, 1.0]]][:n]
        for n in (1, 2)
        for _ in range(6_000)
    ]
    assert [f["properties"]["reason"] for f in written["features"]][5_999:6_001] == [
        "\ufffd\ufffd 1",
        "\ufffd\ufffd 2",
    ]
    names = [f["properties"]["id"] for f in written["features"]]
    assert len(set(names)) == len(names)
    assert names[:2] == ["s0.00_0.00_200.00_200.00", "s0.00_0.00_200.00_200.00~2"]


def test_walls_in_pixels_are_no_walls_for_a_map(tmp_path: Path) -> None:
    reading = Reading((WALL,), (), (), (5.0, 4.0), Scale("unknown", None), "outlined")
    write_reading(reading, tmp_path)
    written = json.loads((tmp_path / "walls.geojson").read_text())
    assert written["unit"] == "px"
    assert written["features"][0]["properties"]["thickness_px"] == 0.2
    with pytest.raises(UnsupportedMedia, match="scale is unknown"):
        load_walls_and_columns(tmp_path / "walls.geojson")


@pytest.mark.parametrize(
    ("content", "refusal"),
    [
        ("", FileEmpty),
        ("walls", UnsupportedMedia),
        ("[" * 100_000, UnsupportedMedia),
        ("[]", UnsupportedMedia),
        ('{"features": 3}', UnsupportedMedia),
        (json.dumps({"features": [7]}), FileMalformed),
        (json.dumps({"features": [{"geometry": None}]}), FileMalformed),
        (json.dumps({"features": [{"geometry": {"type": "Point"}}]}), FileMalformed),
        (json.dumps({"features": [{"geometry": {"type": "Polygon"}}]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0]])]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0], ["a", 1]])]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0], [float("nan"), 1]])]}), NotFinite),
        (json.dumps({"features": [feature([[0, 0], [1e9, 1]])]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0], [1, 1]], thickness_m="wide")]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0], [1, 1]], thickness_m=float("inf"))]}), NotFinite),
        (json.dumps({"features": [feature([[0, 0], [1, 1]], thickness_m=-1)]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0], [1, 1]], faces=[[[0, 0], [1, 1]]])]}), FileMalformed),
        (json.dumps({"features": [feature([[0, 0], [1, 1]])] * 3}), FileMalformed),
    ],
)
def test_a_file_that_breaks_the_format_is_refused(
    tmp_path: Path, content: str, refusal: type[Exception]
) -> None:
    path = tmp_path / "walls.geojson"
    path.write_text(content)
    with pytest.raises(refusal):
        load_walls_and_columns(path, bounds=Bounds(max_walls=2))
