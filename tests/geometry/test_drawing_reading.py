"""Readings of generated sheets whose walls are known."""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from PIL import Image, ImageDraw, ImageFont

from service.domain.errors import NoWallsFound
from worker.geometry.drawing.raster.read import read_raster
from worker.geometry.drawing.reading.reading import Reading, Wall, offset_polyline
from worker.geometry.drawing.scale.decision import Scale, given

SCALE = 0.01
HEIGHT_M = 10.0
ROOM = [
    [(2.0, 2.0), (10.0, 2.0)],
    [(10.0, 2.0), (10.0, 8.0)],
    [(10.0, 8.0), (2.0, 8.0)],
    [(2.0, 8.0), (2.0, 2.0)],
    [(6.0, 2.0), (6.0, 6.0)],
]


class _Sheet:
    """Draw in metres, y up, at 1 cm a pixel."""

    def __init__(self, paper: int = 255) -> None:
        self.image = Image.new("L", (1300, 1000), paper)
        self.pen = ImageDraw.Draw(self.image)

    def px(self, point: tuple[float, float]) -> tuple[float, float]:
        return point[0] / SCALE, (HEIGHT_M - point[1]) / SCALE

    def line(self, a: tuple[float, float], b: tuple[float, float], *, width: int, grey: int = 0) -> None:
        self.pen.line([self.px(a), self.px(b)], fill=grey, width=width)

    def box(self, a: tuple[float, float], b: tuple[float, float], *, width: int) -> None:
        for c, d in (((a[0], a[1]), (b[0], a[1])), ((b[0], a[1]), b), (b, (a[0], b[1])), ((a[0], b[1]), a)):
            self.line(c, d, width=width)

    def text(self, at: tuple[float, float], words: str) -> None:
        self.pen.text(self.px(at), words, fill=0, font=ImageFont.load_default(size=28))

    def grey(self) -> np.ndarray:
        return np.array(self.image)


def outlined_room(sheet: _Sheet, thickness: float = 0.2) -> None:
    """Draw the room of ROOM as two lines a wall, 3 px wide, the lines ending at each other."""
    body = shapely.union_all(
        [shapely.LineString(w).buffer(thickness / 2, cap_style="square", join_style="mitre") for w in ROOM]
    )
    for ring in [body.exterior, *body.interiors]:
        points = list(ring.coords)
        for a, b in pairwise(points):
            sheet.line(a, b, width=3)


def dimension(sheet: _Sheet, y: float) -> None:
    sheet.line((2.0, y), (10.0, y), width=1, grey=60)
    for x in (2.0, 10.0):
        sheet.line((x, 1.7), (x, y - 0.15), width=1, grey=60)
        sheet.line((x - 0.1, y - 0.1), (x + 0.1, y + 0.1), width=2)
    sheet.text((5.7, y + 0.35), "8000")


def dashes(sheet: _Sheet) -> None:
    for x in np.arange(2.5, 5.5, 0.4):
        sheet.line((x, 5.0), (x + 0.25, 5.0), width=2)


def bodies(reading: Reading) -> shapely.Geometry:
    return shapely.union_all(
        [shapely.LineString(w.centre).buffer(max(w.thickness / 2, 0.01)) for w in reading.walls]
    )


def assert_walls(reading: Reading, expected: list, tolerance: float) -> None:
    found = bodies(reading)
    for wall in expected:
        line = shapely.LineString(wall)
        assert line.intersection(found.buffer(tolerance)).length >= 0.95 * line.length, wall
    truth = shapely.MultiLineString(expected).buffer(tolerance + 0.1)
    centres = shapely.MultiLineString([w.centre for w in reading.walls])
    assert centres.difference(truth).length <= 0.03 * centres.length


def layers_at(reading: Reading, box: tuple[float, float, float, float]) -> set[str]:
    area = shapely.box(*box)
    return {r.layer for r in reading.removed for line in r.lines if area.contains(shapely.LineString(line))}


def test_an_outlined_room_comes_back_with_its_thickness_and_all_else_is_set_aside_with_a_reason() -> None:
    sheet = _Sheet()
    outlined_room(sheet)
    dimension(sheet, 1.0)
    dashes(sheet)
    sheet.text((7.3, 5.0), "HALL 2")
    sheet.box((7.0, 6.5), (8.2, 7.2), width=3)
    reading = read_raster(sheet.grey(), scale=given(SCALE))
    assert_walls(reading, ROOM, 0.05)
    thick = [w.thickness for w in reading.walls if w.kind == "wall" and w.length > 1.0]
    assert len(thick) >= 5
    assert np.allclose(thick, 0.2, atol=0.02)
    assert layers_at(reading, (7.2, 4.5, 9.5, 5.2)) == {"text"}
    assert layers_at(reading, (6.9, 6.4, 8.3, 7.3)) == {"symbol"}
    assert layers_at(reading, (2.3, 4.8, 5.9, 5.2)) == {"dashed"}
    assert "light-pen" in layers_at(reading, (1.8, 0.8, 10.2, 1.8))
    assert all(r.reason for r in reading.removed)
    assert (reading.style, reading.unit, reading.sheet) == ("outlined", "m", pytest.approx((13.0, 10.0)))


def test_filled_walls_come_back_with_the_drawn_thickness() -> None:
    sheet = _Sheet()
    for a, b in ROOM:
        sheet.line(a, b, width=20)
    for x, y in ((2.0, 2.0), (10.0, 2.0), (10.0, 8.0), (2.0, 8.0)):
        sheet.pen.rectangle([*sheet.px((x - 0.1, y + 0.1)), *sheet.px((x + 0.1, y - 0.1))], fill=0)
    sheet.pen.rectangle([*sheet.px((8.0, 5.4)), *sheet.px((8.4, 5.0))], fill=0)
    dimension(sheet, 1.0)
    sheet.text((7.3, 4.0), "HALL 2")
    reading = read_raster(sheet.grey(), scale=given(SCALE))
    assert reading.style == "filled"
    assert_walls(reading, ROOM, 0.05)
    assert np.allclose([w.thickness for w in reading.walls if w.length > 1.0], 0.2, atol=0.03)
    pier = shapely.Polygon(reading.columns[0].outline)
    assert len(reading.columns) == 1
    assert pier.centroid.distance(shapely.Point(8.2, 5.2)) < 0.03
    assert pier.area == pytest.approx(0.16, rel=0.15)


def test_a_single_line_plan_comes_back_as_partitions() -> None:
    sheet = _Sheet()
    for a, b in ROOM:
        sheet.line(a, b, width=3)
    sheet.text((7.3, 5.0), "HALL 2")
    reading = read_raster(sheet.grey(), scale=given(SCALE))
    assert reading.style == "single-line"
    assert_walls(reading, ROOM, 0.03)
    assert {w.kind for w in reading.walls} == {"partition"}


def test_shade_and_noise_change_little() -> None:
    sheet = _Sheet()
    outlined_room(sheet)
    y, x = np.mgrid[0:1000, 0:1300]
    light = 0.55 + 0.45 * np.exp(-(((x - 900) / 700) ** 2 + ((y - 300) / 600) ** 2))
    noise = np.random.default_rng(3).normal(0, 6, light.shape)
    grey = np.clip(sheet.grey() * light + noise, 0, 255).astype(np.uint8)
    assert_walls(read_raster(grey, scale=given(SCALE)), ROOM, 0.06)


def test_stair_treads_are_no_walls() -> None:
    sheet = _Sheet()
    outlined_room(sheet)
    for k in range(9):
        sheet.line((2.1, 3.0 + 0.28 * k), (3.4, 3.0 + 0.28 * k), width=3)
    reading = read_raster(sheet.grey(), scale=given(SCALE))
    inside = bodies(reading).intersection(shapely.box(2.3, 3.1, 3.3, 5.1))
    assert inside.is_empty


def test_without_a_scale_the_walls_are_in_pixels_and_a_finding_says_so() -> None:
    sheet = _Sheet()
    outlined_room(sheet)
    reading = read_raster(sheet.grey(), scale=Scale("unknown", None))
    assert (reading.unit, reading.sheet) == ("px", pytest.approx((1300, 1000)))
    assert [f.code for f in reading.findings] == ["scale-unknown"]
    assert bodies(reading).buffer(5).covers(shapely.LineString([(250, 200), (950, 200)]))


@pytest.mark.parametrize("grey", [255, 128])
def test_a_blank_sheet_has_no_walls(grey: int) -> None:
    with pytest.raises(NoWallsFound):
        read_raster(np.full((400, 500), grey, dtype=np.uint8), scale=given(SCALE))


def test_a_black_sheet_has_no_walls() -> None:
    reading = read_raster(np.zeros((400, 500), dtype=np.uint8), scale=given(SCALE))
    assert (reading.walls, [f.code for f in reading.findings]) == ((), ["no-walls"])


def test_a_sheet_of_text_alone_has_no_walls() -> None:
    sheet = _Sheet()
    sheet.text((2.0, 5.0), "to be drawn later")
    reading = read_raster(sheet.grey(), scale=given(SCALE))
    assert reading.walls == ()
    assert [f.code for f in reading.findings] == ["no-walls"]
    assert "Check the scale" in reading.findings[0].message
    assert len(reading.removed) > 0


def test_a_scale_of_nothing_is_a_defect() -> None:
    with pytest.raises(ValueError, match="positive"):
        read_raster(np.full((10, 10), 255, dtype=np.uint8), scale=given(0.0))


def test_progress_is_told_and_may_cancel() -> None:
    sheet = _Sheet()
    outlined_room(sheet)
    told: list[float] = []
    read_raster(sheet.grey(), scale=given(SCALE), progress=lambda _, share: told.append(share))
    assert told == sorted(told)

    def cancel(stage: str, _share: float) -> None:
        if stage == "cleanup":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        read_raster(sheet.grey(), scale=given(SCALE), progress=cancel)


def test_faces_run_parallel_also_around_a_corner() -> None:
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
    wall = Wall.of(corner, thickness=0.2)
    assert np.allclose(wall.faces[0], [[0.0, 0.1], [3.9, 0.1], [3.9, 3.0]])
    assert np.allclose(wall.faces[1], [[0.0, -0.1], [4.1, -0.1], [4.1, 3.0]])
    assert np.allclose(offset_polyline(corner, 0.0), corner)
    assert wall.length == pytest.approx(7.0)
