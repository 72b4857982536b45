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

SEED = 7
OFF_M = 2.0
RECIPE = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}


@dataclass(frozen=True)
class Plant:
    """Hold a running service with a map, and a scan whose true pose is known."""

    running: Running
    admin: Client
    map_id: str
    scan_file: bytes
    truth: Transform


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Give service and worker, with revision 1 of a hall built and published."""
    hall = synthetic_hall(SEED)
    with groundplan_up(tmp_path_factory.mktemp("plant")) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 3")
        drawing = steps.read_drawing(admin, map_id, drawing_png(hall), clicked=known_length(hall))
        n = steps.build_revision(admin, map_id, drawing_id=drawing["id"], recipe=RECIPE)
        steps.publish(admin, map_id, n)
        scan = scan_of_new_machine(hall, seed=SEED)
        yield Plant(running, admin, map_id, ply_bytes(scan.cloud.points), scan.T_map_scan)


def orange(canvas: Locator) -> NDArray[np.float64]:
    """Return the pixels (x, y) of the canvas that show the scan."""
    pixels = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    found = (pixels[..., 0] > 200) & (np.abs(pixels[..., 1] - 106) < 60) & (pixels[..., 2] < 90)
    return np.argwhere(found)[:, ::-1].astype(np.float64)


def _value(page: Page, label: str) -> float:
    return float(page.get_by_label(label).input_value())


def _send_the_scan(page: Page, plant: Plant) -> None:
    page.get_by_role("link", name="Hall 3").first.click()
    scans = page.get_by_role("region", name="Scans")
    file = {"name": "press.ply", "mimeType": "application/octet-stream", "buffer": plant.scan_file}
    scans.get_by_label("Send a scan").set_input_files([file])
    scans.get_by_role("link", name="Place").click(timeout=60_000)


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
    expect(accept).to_be_visible(timeout=60_000)
    yaw = math.radians(_value(page, "Turn [°]"))
    x, y, _ = plant.truth.translation
    assert math.hypot(_value(page, "x [m]") - x, _value(page, "y [m]") - y) < 0.1
    assert abs(math.remainder(yaw - plant.truth.rpy[2], math.tau)) < math.radians(1.0)
    watched.accessible()
    page.screenshot(path=pictures / "placement.png")
    page.get_by_role("button", name="In 3-D").click()
    expect(page.locator("canvas.cloud[data-drawn=room]")).to_be_visible()
    assert len(orange(canvas)) > 500
    page.screenshot(path=pictures / "placement-3d.png")

    accept.click()
    expect(page.get_by_text("Revision made:")).to_be_visible(timeout=60_000)
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
