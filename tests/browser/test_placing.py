"""A scan dragged two metres off, snapped, accepted, published and rolled back, on the real thing."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Locator, Page, expect

from demo import steps
from demo.client import Client
from demo.hall import WALL_HEIGHT, synthetic_hall
from demo.running import Running, groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, scan_of_new_machine
from service.domain.transform import Transform
from tests.browser.conftest import Visit
from worker.geometry.cloud.point_cloud import Label

SEED = 7
OFF_M = 2.0
EVIDENCE = {
    "Share of the points near the map": "inlier_share",
    "Median distance of these [m]": "residual_median_m",
    "Euclidean fitness score [m²]": "euclidean_fitness_score_m2",
    "Share seen through the map's walls": "contradicted_share",
}
"""What the page shows of a placement's evidence, under which words."""
RECIPE = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}


@dataclass(frozen=True)
class Plant:
    """Hold a running service with a map, and a scan whose true pose is known."""

    running: Running
    admin: Client
    map_id: str
    scan_file: bytes
    truth: Transform
    machine: NDArray[np.float64]

    def cloud(self, map_id: str, n: int, *, label: Label | None = None) -> NDArray[np.float64]:
        """Return the points (N, 3) of a revision [m], or those with a label."""
        where = f"/v1/maps/{map_id}/revisions/{n}/artifacts/point-cloud.pcd"
        content = self.admin.request("GET", where, expected=(200,)).content
        records = np.frombuffer(content[content.index(b"DATA binary\n") + 12 :], dtype="<u4").reshape(-1, 4)
        kept = records if label is None else records[records[:, 3] == label]
        return np.ascontiguousarray(kept[:, :3]).view("<f4").astype(np.float64)


def a_map_of_the_hall(admin: Client, name: str) -> str:
    """Return the id of a new map with one revision, built and published."""
    hall = synthetic_hall(SEED)
    map_id = steps.make_map(admin, site="Nagoya", name=name)
    drawing = steps.read_drawing(admin, map_id, drawing_png(hall), clicked=known_length(hall))
    n = steps.build_revision(admin, map_id, drawing_id=drawing["id"], recipe=RECIPE)
    steps.publish(admin, map_id, n)
    return map_id


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Give service and worker, with revision 1 of a hall built and published."""
    hall = synthetic_hall(SEED)
    with groundplan_up(tmp_path_factory.mktemp("plant")) as running:
        admin = Client(running.address, running.admin_key)
        map_id = a_map_of_the_hall(admin, "Hall 3")
        scan = scan_of_new_machine(hall, seed=SEED)
        machine = np.array([hall.new_machine.x, hall.new_machine.y])
        yield Plant(running, admin, map_id, ply_bytes(scan.cloud.points), scan.T_map_scan, machine)


def orange(canvas: Locator) -> NDArray[np.float64]:
    """Return the pixels (x, y) of the canvas that show the scan."""
    pixels = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    found = (pixels[..., 0] > 200) & (np.abs(pixels[..., 1] - 106) < 60) & (pixels[..., 2] < 90)
    return np.argwhere(found)[:, ::-1].astype(np.float64)


def green(canvas: Locator) -> int:
    """Return how many pixels of the canvas show points that lie on walls."""
    pixels = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    return int((np.abs(pixels - (26, 152, 80)).max(axis=2) < 25).sum())


def _value(page: Page, label: str) -> float:
    return float(page.get_by_label(label).input_value())


def _send_the_scan(page: Page, plant: Plant) -> None:
    page.get_by_role("link", name="Hall 3").first.click()
    scans = page.get_by_role("region", name="Scans")
    file = {"name": "press.ply", "mimeType": "application/octet-stream", "buffer": plant.scan_file}
    scans.get_by_label("Send a scan").set_input_files([file])
    scans.get_by_role("link", name="Place").click()


def put_roughly(page: Page, truth: Transform) -> None:
    x, y, _ = truth.translation
    page.get_by_label("Turn [°]").fill(f"{math.degrees(truth.rpy[2]) + 6:.2f}")
    page.get_by_label("Turn [°]").blur()
    for label, value in (("x [m]", x), ("y [m]", y)):
        page.get_by_label(label).fill(f"{value:.3f}")
        page.get_by_label(label).blur()


def drag_off(page: Page, canvas: Locator) -> None:
    """Drag the scan until the numbers say that it is two metres away."""
    before = _value(page, "x [m]")
    at = orange(canvas)
    box = canvas.bounding_box()
    assert box is not None
    start = at.mean(axis=0) + np.array([box["x"], box["y"]])
    page.mouse.move(*start)
    page.mouse.down()
    for pixels in range(1, 400):
        page.mouse.move(start[0] + pixels, start[1])
        if abs(_value(page, "x [m]") - before) >= OFF_M:
            break
    page.mouse.up()
    page.wait_for_timeout(100)
    assert abs(_value(page, "x [m]") - before) == pytest.approx(OFF_M, abs=0.3)
    moved = orange(canvas)
    assert moved[:, 0].mean() - at[:, 0].mean() == pytest.approx(pixels, abs=3.0)
    assert moved[:, 1].mean() == pytest.approx(at[:, 1].mean(), abs=3.0)


def test_a_scan_is_dragged_snapped_accepted_published_and_rolled_back(
    plant: Plant, visit: Visit, pictures: Path
) -> None:
    watched = visit(plant.running.address)
    page = watched.page
    watched.sign_in(plant.running.admin_key)
    _send_the_scan(page, plant)
    canvas = page.locator("canvas.cloud[data-drawn]")
    expect(canvas).to_be_visible()
    put_roughly(page, plant.truth)
    page.wait_for_timeout(100)
    assert len(orange(canvas)) > 500
    drag_off(page, canvas)

    page.get_by_role("button", name="Snap").click()
    accept = page.get_by_role("button", name="ccept")
    expect(accept).to_be_visible()
    yaw = math.radians(_value(page, "Turn [°]"))
    x, y, _ = plant.truth.translation
    assert math.hypot(_value(page, "x [m]") - x, _value(page, "y [m]") - y) < 0.1
    assert abs(math.remainder(yaw - plant.truth.rpy[2], math.tau)) < math.radians(1.0)
    watched.accessible()
    expect(page.get_by_text("In 95 of 100 cases within")).to_be_visible()
    evidence = plant.admin.get(f"/v1/placements?map={plant.map_id}")["items"][0]["evidence"]
    for label, member in EVIDENCE.items():
        shown = page.locator(".verdict dt").filter(has_text=label).locator("+ dd").inner_text()
        assert float(shown) == pytest.approx(evidence[member], rel=0.005), member
    assert green(canvas) > 200
    page.screenshot(path=pictures / "placement.png")
    page.get_by_role("button", name="In 3-D").click()
    expect(page.locator("canvas.cloud[data-drawn=room]")).to_be_visible()
    assert len(orange(canvas)) > 500
    page.screenshot(path=pictures / "placement-3d.png")

    accept.click()
    expect(page.get_by_text("Revision made:")).to_be_visible()
    page.get_by_role("link", name="Back").click()
    revisions = page.get_by_role("region", name="Revisions")
    publish(page, revisions, "Revision 2", "Publish")
    assert plant.admin.get(f"/v1/maps/{plant.map_id}/published")["revision"] == 2
    watched.accessible()
    page.screenshot(path=pictures / "map.png")
    publish(page, revisions, "Revision 1", "Roll back to this")
    assert plant.admin.get(f"/v1/maps/{plant.map_id}/published")["revision"] == 1
    page.get_by_role("link", name="Overview").click()
    expect(page.get_by_text("Published: 1")).to_be_visible()
    watched.accessible()
    page.screenshot(path=pictures / "overview.png")
    watched.clean()


def publish(page: Page, revisions: Locator, which: str, word: str) -> None:
    row = revisions.get_by_role("listitem").filter(has_text=which)
    row.get_by_role("button", name=word).click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_text("Robots of this map")).to_be_visible()
    expect(dialog.locator(".loading")).to_have_count(0)
    reason = dialog.get_by_label("Publish all the same, because")
    if reason.count():
        reason.fill("looked at on the spot")
    dialog.get_by_role("button", name=word).click()
    expect(row.get_by_text("Published")).to_be_visible()


def test_a_scan_is_placed_by_keyboard_and_what_was_circled_is_left_out(plant: Plant, visit: Visit) -> None:
    map_id = a_map_of_the_hall(plant.admin, "Hall 4")
    scan = steps.read_scan(plant.admin, map_id, plant.scan_file)
    watched = visit(plant.running.address)
    page = watched.page
    watched.sign_in(plant.running.admin_key)
    page.goto(f"{plant.running.address}/#/maps/{map_id}/scans/{scan['id']}")
    canvas = page.locator("canvas.cloud[data-settled=true]")
    expect(canvas).to_be_visible()
    put_roughly(page, plant.truth)
    before = _value(page, "x [m]"), _value(page, "y [m]"), _value(page, "Turn [°]")
    canvas.focus()
    for key in ("Shift+ArrowRight", "ArrowRight", "ArrowDown", "q"):
        page.keyboard.press(key)
    after = _value(page, "x [m]"), _value(page, "y [m]"), _value(page, "Turn [°]")
    np.testing.assert_allclose(np.subtract(after, before)[2], 1.0, atol=0.01)
    page.keyboard.press("Enter")
    accept = page.get_by_role("button", name="ccept")
    expect(accept).to_be_visible()

    cloud = plant.cloud(map_id, 1)
    page.get_by_role("button", name="Circle what to leave out").click()
    (low, high), box = (cloud.min(axis=0), cloud.max(axis=0)), canvas.bounding_box()
    assert box is not None
    span = high - low
    metres = 1.1 * max(span[1], span[0] * box["height"] / box["width"]) / box["height"]
    corners = plant.machine + np.array([[-4, -4], [0, -4], [0, 4], [-4, 4]])
    pixels = (corners - 0.5 * (low + high)[:2]) * (1.0, -1.0) / metres
    pixels += (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.move(*pixels[0])
    page.mouse.down()
    for corner in pixels[1:]:
        page.mouse.move(*corner, steps=12)
    page.mouse.up()
    expect(page.get_by_role("button", name="Circle what to leave out (1)")).to_be_visible()
    accept.click()
    expect(page.get_by_text("Revision made:")).to_be_visible()

    (made,) = plant.admin.get(f"/v1/revisions?map={map_id}&status=ready&limit=1")["items"]
    (part,) = (layer["part"] for layer in made["layers"] if layer["scan_id"] == scan["id"])
    drawn = np.array(part["exclude"][0]["within"])
    np.testing.assert_allclose(drawn.min(axis=0), corners.min(axis=0), atol=3 * metres)
    np.testing.assert_allclose(drawn.max(axis=0), corners.max(axis=0), atol=3 * metres)
    taken = plant.cloud(map_id, made["n"], label=Label.LAYER)
    inside = ((taken[:, :2] > drawn.min(axis=0) + 0.1) & (taken[:, :2] < drawn.max(axis=0) - 0.1)).all(axis=1)
    beside = (np.abs(taken[:, :2] - plant.machine) < 4.0).all(axis=1)
    assert not inside.any()
    assert (beside & ~inside).sum() > 20
    watched.clean()
