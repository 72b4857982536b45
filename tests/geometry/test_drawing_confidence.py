"""No bad reading passes for a good one: photos, robots' maps, blank sheets, several plans, scribbles."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import skimage
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from service.domain.drawing_options import DrawingOptions
from service.domain.errors import NotADrawing, NoWallsFound
from service.domain.scale_hint import ScaleHint
from worker.formats.drawing import read_drawing_file
from worker.geometry.drawing.raster.sheet_kind import check_sheet, robot_map_finding, tones_of
from worker.geometry.drawing.reading.confidence import LEAST, judge
from worker.geometry.drawing.reading.plans import several_plans
from worker.geometry.drawing.reading.reading import Reading, RemovedStroke, Wall
from worker.geometry.drawing.scale.decision import Scale, given

PHOTOS = ("astronaut", "camera", "chelsea", "coffee", "coins", "brick", "grass", "gravel")


def a_plan(width: int = 900, height: int = 700, *, wall: int = 8, grey: int = 0) -> NDArray[np.uint8]:
    """Return a sheet of two rooms in filled walls, with letters."""
    image = Image.new("L", (width, height), 255)
    pen = ImageDraw.Draw(image)
    pen.rectangle((100, 100, width - 100, height - 100), outline=grey, width=wall)
    pen.line((width // 2, 100, width // 2, height - 260), fill=grey, width=wall)
    pen.text((200, 200), "HALL 1", fill=0, font_size=40)
    return np.array(image)


def a_photo(seed: int) -> NDArray[np.uint8]:
    """Return soft blobs and grain in all shades: what any photo is made of."""
    rng = np.random.default_rng(seed)
    coarse = Image.fromarray(rng.integers(30, 226, (12, 16), dtype=np.uint8)).resize(
        (1200, 900), Image.Resampling.BICUBIC
    )
    fine = np.asarray(
        Image.fromarray(rng.integers(0, 256, (900, 1200), dtype=np.uint8)).filter(ImageFilter.GaussianBlur(2))
    )
    return np.clip(np.asarray(coarse, dtype=np.int16) + fine.astype(np.int16) // 2 - 64, 0, 255).astype(
        np.uint8
    )


def a_robot_map(seed: int, *, unknown: int = 205) -> NDArray[np.uint8]:
    """Return an occupancy grid: rooms seen with ragged walls, unknown around."""
    rng = np.random.default_rng(seed)
    grid = np.full((400, 300), unknown, dtype=np.uint8)
    for x, y, w, h in ((40, 50, 120, 200), (150, 80, 100, 90), (150, 160, 90, 180)):
        grid[y : y + h, x : x + w] = 254
        for side in ((slice(y, y + h), x), (slice(y, y + h), x + w - 1)):
            grid[side] = np.where(rng.random(h) < 0.85, 0, unknown)
        for side in ((y, slice(x, x + w)), (y + h - 1, slice(x, x + w))):
            grid[side] = np.where(rng.random(w) < 0.85, 0, unknown)
    return grid


@pytest.mark.parametrize("name", PHOTOS)
def test_a_photo_is_refused(name: str) -> None:
    folder = Path(skimage.__file__).parent / "data"
    with Image.open(folder / f"{name}.png") as image:
        grey = np.asarray(image.convert("L"))
    with pytest.raises(NotADrawing):
        check_sheet(grey)


@pytest.mark.parametrize("seed", range(5))
def test_a_generated_photo_is_refused_too(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    Image.fromarray(a_photo(seed)).save(path, quality=85)
    with pytest.raises(NotADrawing) as refused:
        read_drawing_file(path, options=DrawingOptions())
    assert refused.value.members["paper"] < 0.5


@pytest.mark.parametrize("wall", [3, 8, 24])
@pytest.mark.parametrize("grey", [0, 110])
def test_a_drawing_is_none(wall: int, grey: int) -> None:
    plan = a_plan(wall=wall, grey=grey)
    assert check_sheet(plan) == ()
    y, x = np.mgrid[0:700, 0:900]
    light = 0.55 + 0.45 * np.exp(-(((x - 600) / 500) ** 2 + ((y - 200) / 400) ** 2))
    noise = np.random.default_rng(3).normal(0, 6, light.shape)
    assert check_sheet(np.clip(plan * light + noise, 0, 255).astype(np.uint8)) == ()


def test_grey_rooms_and_grey_paper_are_no_photo() -> None:
    plan = a_plan()
    plan[120:580, 120:440][plan[120:580, 120:440] == 255] = 190
    assert check_sheet(plan) == ()
    assert check_sheet((plan * 0.6).astype(np.uint8)) == ()
    assert tones_of(plan).tones == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("unknown", [205, 127])
@pytest.mark.parametrize("seed", range(2))
def test_a_robot_s_map_is_marked(seed: int, unknown: int, tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    Image.fromarray(a_robot_map(seed, unknown=unknown)).save(path)
    found = check_sheet(np.asarray(Image.open(path)))
    assert [(f.code, f.severity) for f in found] == [("robot-map", "serious")]
    assert found[0].values["unknown_level"] == unknown
    reading = read_drawing_file(path, options=DrawingOptions(scale=ScaleHint(metres_per_unit=0.05)))
    assert found[0] in reading.findings


def test_a_drawing_is_no_robot_s_map() -> None:
    assert robot_map_finding(a_plan()) is None
    assert robot_map_finding(a_plan(grey=120)) is None
    assert robot_map_finding((a_plan() * 0.8).astype(np.uint8)) is None


def test_a_blank_sheet_has_no_walls(tmp_path: Path) -> None:
    path = tmp_path / "blank.png"
    Image.new("L", (600, 400), 250).save(path)
    with pytest.raises(NoWallsFound):
        read_drawing_file(path, options=DrawingOptions(scale=ScaleHint(metres_per_unit=0.02)))


def reading_of(walls: list[Wall], removed: tuple[RemovedStroke, ...] = (), scale: float = 0.01) -> Reading:
    return Reading(tuple(walls), (), removed, (40.0, 30.0), given(scale), "outlined", top=30.0)


def room(x: float, y: float, width: float = 8.0, height: float = 6.0) -> list[Wall]:
    corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)]
    return [Wall.of(np.array(ends), thickness=0.2) for ends in pairwise(corners)]


def test_a_room_is_sure_and_its_walls_are() -> None:
    judged = judge(reading_of(room(2, 2)))
    assert judged.confidence > 0.9
    assert all(w.confidence > 0.9 for w in judged.walls)
    assert judged.findings == ()


def test_scattered_pieces_in_all_directions_are_not() -> None:
    rng = np.random.default_rng(4)
    starts, angles = rng.uniform(2, 28, (150, 2)), rng.uniform(0, np.pi, 150)
    ends = starts + 0.6 * np.column_stack([np.cos(angles), np.sin(angles)])
    walls = [Wall.of(np.stack(pair), thickness=0.2) for pair in zip(starts, ends, strict=True)]
    judged = judge(reading_of(walls))
    assert judged.confidence < LEAST
    (finding,) = judged.findings
    assert (finding.code, finding.severity) == ("low-confidence", "serious")
    assert finding.values["aligned_mark"] < 0.4


@pytest.mark.parametrize("factor", [0.05, 100.0])
def test_a_building_of_a_wrong_size_is_not(factor: float) -> None:
    judged = judge(replace(reading_of(room(2, 2)).scaled(factor), scale=given(factor)))
    assert judged.confidence < LEAST
    in_pixels = replace(reading_of(room(2, 2)).scaled(factor), scale=Scale("unknown", None))
    assert judge(in_pixels).confidence > 0.8


def test_a_loose_wall_is_less_sure_than_a_joined_one() -> None:
    loose = Wall.of(np.array([[20.0, 20.0], [22.0, 20.0]]), thickness=0.2)
    walls = judge(reading_of([*room(2, 2), loose])).walls
    assert walls[-1].confidence < min(w.confidence for w in walls[:-1])


def test_a_few_walls_among_much_else_are_doubted() -> None:
    lines = tuple(np.array([[x, 9.0], [x, 28.0]]) for x in np.arange(1.0, 39.0, 0.25))
    crowd = reading_of(room(2, 2), (RemovedStroke(lines, "hatch", "regular"),))
    assert judge(crowd).confidence < judge(reading_of(room(2, 2))).confidence - 0.2


def test_several_plans_are_told_with_polygons_that_an_edit_takes() -> None:
    reading = reading_of([*room(2, 2), *room(16, 2), *room(2, 14, 6, 5)])
    finding = several_plans(reading)
    assert finding is not None
    assert finding.where is not None
    boxes = list(shapely.from_geojson(json.dumps(finding.where.to_json())).geoms)
    assert len(boxes) == 3
    inside_first = shapely.LineString([(210, 2790), (990, 2410)])
    assert [box.contains(inside_first) for box in boxes].count(True) == 1


def test_one_plan_with_a_core_is_one() -> None:
    assert several_plans(reading_of([*room(2, 2, 30, 24), *room(14, 10, 5, 5)])) is None
    assert several_plans(reading_of([*room(2, 2), *room(11, 2)])) is None


def test_one_of_two_plans_on_a_sheet_is_included_by_its_polygon(tmp_path: Path) -> None:
    image = Image.new("L", (1500, 700), 255)
    pen = ImageDraw.Draw(image)
    for left in (100, 900):
        pen.rectangle((left, 100, left + 500, 600), outline=0, width=10)
        pen.line((left + 250, 100, left + 250, 450), fill=0, width=10)
    path = tmp_path / "two.png"
    image.save(path)
    options = DrawingOptions(scale=ScaleHint(metres_per_unit=0.02))
    both = read_drawing_file(path, options=options)
    (finding,) = [f for f in both.findings if f.code == "several-plans"]
    rings = [rings[0] for rings in finding.to_json()["where"]["coordinates"]]
    assert len(rings) == finding.values["plans"] == 2
    edit = {"action": "include", "within": min(rings)}
    one = read_drawing_file(path, options=options.changed({"edits": [edit]}))
    assert [f.code for f in one.findings if f.code in {"several-plans", "edit-does-not-fit"}] == []
    assert max(float(w.centre[:, 0].max()) for w in one.walls) < 12.5
    kept, total = (sum(w.length for w in reading.walls) for reading in (one, both))
    assert kept == pytest.approx(total / 2, rel=0.02)


def test_a_reading_without_walls_is_sure_of_nothing() -> None:
    assert judge(reading_of([])).confidence == 0.0
