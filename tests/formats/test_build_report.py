"""`report.json` says where the drawing lies in the map: its file's coordinates and the cloud's agree."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from service.domain.transform import Transform
from tests.formats.cad_plans import draw_plan, new_drawing, saved
from worker.cli import main
from worker.formats.pcd import read_pcd

VOXEL_M = 0.1
CORNERS = [(0.0, 0.0), (20.0, 0.0), (20.0, 12.0), (0.0, 12.0)]
"""Outer corners of `draw_plan` [m]."""


def built(drawing: Path, out: Path, *more: str) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Return the report of a map and the points of its cloud."""
    assert main(["build", str(drawing), *more, "--voxel-size", str(VOXEL_M), "-o", str(out)]) == 0
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return report, read_pcd(out / "point-cloud.pcd").points


def assert_lies(
    report: dict[str, Any], cloud: NDArray[np.float64], corners: NDArray[np.float64], on: NDArray[np.float64]
) -> None:
    """Hold that the cloud reaches to the corners, and has a wall at the other points, of the file [m]."""

    def placed(points: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = np.column_stack([points, np.zeros(len(points))])
        return Transform.of(report["T_map_drawing"]).apply(flat)[:, :2]

    for x, y in placed(on):
        assert np.hypot(cloud[:, 0] - x, cloud[:, 1] - y).min() < 0.75 * VOXEL_M, (x, y)
    low, high = placed(corners).min(axis=0), placed(corners).max(axis=0)
    assert cloud[:, :2].min(axis=0) == pytest.approx(low, abs=0.5 * VOXEL_M)
    assert cloud[:, :2].max(axis=0) == pytest.approx(high, abs=0.5 * VOXEL_M)


@pytest.mark.parametrize("turn", [0.0, 90.0])
@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (51_234.25, -8_765.5)])
@pytest.mark.parametrize(("unit", "metres"), [(4, 0.001), (6, 1.0)])
def test_a_corner_of_a_dxf_far_from_its_origin_lies_where_the_cloud_has_it(
    tmp_path: Path, unit: int, metres: float, x: float, y: float, turn: float
) -> None:
    doc = new_drawing(unit)
    draw_plan(doc, 1.0 / metres, x=x, y=y)
    drawing = saved(doc, tmp_path / "plan.dxf")
    report, cloud = built(drawing, tmp_path / "map", f"--map-from-drawing=3,-2,{turn}")
    in_file = (np.array(CORNERS) + np.array([x, y])) / metres
    scale = report["inputs"]["scale"]["metres_per_unit"]
    assert scale == pytest.approx(metres)
    assert_lies(report, cloud, in_file * scale, in_file * scale)
    reading = tmp_path / "reading"
    assert main(["read", str(drawing), "-o", str(reading)]) == 0
    told = json.loads((reading / "reading.json").read_text(encoding="utf-8"))
    assert report["drawing_origin"] == told["drawing_origin"]
    pose = Transform.from_xyz_yaw(3.0, -2.0, 0.0, math.radians(turn))
    whole = pose @ Transform.from_xyz_yaw(*(-v for v in told["drawing_origin"]), 0.0, 0.0)
    assert Transform.of(report["T_map_drawing"]).matrix == pytest.approx(whole.matrix, abs=1e-9)


def test_a_corner_of_pixels_is_taken_with_y_turned_up(tmp_path: Path) -> None:
    image = Image.new("L", (800, 600), 255)
    pen = ImageDraw.Draw(image)
    for inset in (90, 110):
        pen.rectangle([inset, inset, 799 - inset, 519 - inset], outline=0, width=3)
    image.save(tmp_path / "room.png")
    report, cloud = built(
        tmp_path / "room.png", tmp_path / "map", "--metres-per-unit=0.01", "--map-from-drawing=5,1,0"
    )
    corners = np.array([(90, 90), (709, 90), (709, 429), (90, 429)])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    assert_lies(report, cloud, corners * [0.01, -0.01], middles * [0.01, -0.01])
