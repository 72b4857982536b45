"""The whole story by clicks: from the drawing to a robot's map, and back."""

from __future__ import annotations

import hashlib
import math
import re
from pathlib import Path

from playwright.sync_api import Page, expect

from demo import steps
from demo.client import Client
from demo.hall import Hall, synthetic_hall
from demo.running import Running, groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import scan_of_new_machine
from tests.bad_network import bad_network
from tests.browser.conftest import Visit
from tests.browser.test_drawing_page import Sheet, box_around, length, save
from tests.browser.test_placing import drag_off, publish
from tests.browser.test_tablet_page import RATE, TABLET, Plant, open_and_sign_in, until_sent

SEED = 1


def _make_map_and_send_drawing(page: Page, hall: Hall) -> str:
    page.get_by_role("button", name="New map").click()
    page.get_by_label("Site").fill("Nagoya")
    page.get_by_label("Floor or hall").fill("Hall 3")
    page.get_by_role("button", name="Make the map").click()
    drawings = page.get_by_role("region", name="Drawings")
    file = {"name": "hall.png", "mimeType": "image/png", "buffer": drawing_png(hall)}
    drawings.get_by_label("Send a drawing").set_input_files([file])
    drawings.get_by_role("link", name="Correct").click()
    found = re.search(r"#/maps/(\w+)/drawings/", page.url)
    assert found is not None
    return found.group(1)


def _correct_and_build(page: Page, admin: Client, map_id: str, hall: Hall) -> None:
    sheet, clicked = Sheet(page), known_length(hall)
    expect(sheet.canvas).to_be_visible()
    (drawing,) = admin.get(f"/v1/maps/{map_id}/drawings")["items"]
    reading = drawing["reading"]
    factor, top = reading["scale"]["metres_per_unit"] or 1.0, reading["drawing_top"]
    page.get_by_role("button", name="Set the scale").click()
    for x, y in ((clicked.x1, clicked.y1), (clicked.x2, clicked.y2)):
        sheet.click((x * factor, top - y * factor))
    page.get_by_label("Length [m]").fill(f"{clicked.length_m}")
    page.get_by_role("button", name="Apply").click()
    expect(page.get_by_role("region", name="Scale").get_by_text("Given", exact=True)).to_be_visible()
    walls = admin.get(drawing["files"]["walls"])["features"]
    inner = min((one for one in walls if one["properties"].get("faces")), key=length)
    page.get_by_role("button", name="Set aside", exact=True).click()
    sheet.lasso(box_around(inner))
    save(page)
    assert len(admin.get(drawing["files"]["walls"])["features"]) < len(walls)
    page.get_by_role("button", name="Undo").click()
    save(page)
    page.get_by_label("Voxel size").fill("0.1")
    page.get_by_role("button", name="Build a revision").click()
    made = page.get_by_role("status").filter(has_text="Revision made: 1")
    expect(made).to_be_visible()
    page.get_by_role("link", name="Back").click()


def _send_scan_from_tablet(visit: Visit, plant: Plant) -> str:
    """Return the id of a scan that was sent while the connection fell twice."""
    content = plant.scan_file(times=3)
    key = plant.admin.post("/v1/keys", {"name": "pad", "role": "tablet", "map_ids": [plant.map_id]})["key"]
    with bad_network(plant.running.address, rate=RATE) as network:
        watched = visit(network.url, **TABLET)
        page = watched.page
        open_and_sign_in(watched, key)
        page.get_by_role("button", name="Begin").tap()
        page.get_by_role("button", name="Hall 3").tap()
        file = {"name": "press.ply", "mimeType": "application/octet-stream", "buffer": content}
        page.get_by_label("Take or choose the scan").set_input_files([file])
        before = network.sent
        page.get_by_role("button", name="I do not know").tap()
        for share in (0.3, 0.7):
            until_sent(network, before + share * len(content))
            network.cut()
        expect(page.get_by_role("link", name="Move it")).to_be_visible()
        assert network.cuts == 2
    (scan,) = plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"]
    assert scan["sha256"] == hashlib.sha256(content).hexdigest()
    return str(scan["id"])


def _robot(plant: Plant) -> Client:
    made = plant.admin.post("/v1/robots", {"name": "AMR 1", "map_id": plant.map_id})
    return Client(plant.running.address, made["key"])


def _told_and_loaded(robot: Client, plant: Plant, *, folder: Path) -> int | None:
    """Return the revision that the robot is told, after it loaded and verified it."""
    n, _ = steps.poll(robot, plant.map_id, known_etag=None)
    if n is not None:
        folder.mkdir()
        steps.download(robot, plant.map_id, n, name="point-cloud.pcd", to=folder / "map.pcd")
    return n


def _move_snap_and_accept(page: Page, plant: Plant, scan_id: str) -> None:
    page.goto(f"{plant.running.address}/#/maps/{plant.map_id}/scans/{scan_id}")
    canvas = page.locator("canvas.cloud[data-drawn]")
    expect(canvas).to_be_visible()
    page.wait_for_timeout(100)
    drag_off(page, canvas)
    page.get_by_role("button", name="Snap").click()
    accept = page.get_by_role("button", name="ccept")
    expect(accept).to_be_visible()
    x, y, yaw = (float(page.get_by_label(label).input_value()) for label in ("x [m]", "y [m]", "Turn [°]"))
    truth = plant.scan.T_map_scan
    assert math.hypot(x - truth.translation[0], y - truth.translation[1]) < 0.1
    assert abs(math.remainder(math.radians(yaw) - truth.rpy[2], math.tau)) < math.radians(1.0)
    accept.click()
    expect(page.get_by_text("Revision made:")).to_be_visible()
    page.get_by_role("link", name="Back").click()


def _story(running: Running, visit: Visit, tmp_path: Path) -> None:
    hall, admin = synthetic_hall(SEED), Client(running.address, running.admin_key)
    watched = visit(running.address)
    page = watched.page
    watched.sign_in(running.admin_key)
    map_id = _make_map_and_send_drawing(page, hall)
    _correct_and_build(page, admin, map_id, hall)
    plant = Plant(running, admin, map_id, scan_of_new_machine(hall, seed=SEED))
    robot = _robot(plant)
    revisions = page.get_by_role("region", name="Revisions")
    publish(page, revisions, "Revision 1", "Publish")
    assert _told_and_loaded(robot, plant, folder=tmp_path / "first") == 1
    scan_id = _send_scan_from_tablet(visit, plant)
    _move_snap_and_accept(page, plant, scan_id)
    publish(page, revisions, "Revision 2", "Publish")
    assert _told_and_loaded(robot, plant, folder=tmp_path / "second") == 2
    publish(page, revisions, "Revision 1", "Roll back to this")
    assert _told_and_loaded(robot, plant, folder=tmp_path / "third") == 1
    clouds = [(tmp_path / name / "map.pcd").read_bytes() for name in ("first", "second", "third")]
    assert clouds[0] == clouds[2] != clouds[1]
    watched.clean()


def test_from_the_drawing_to_a_robot_and_back(visit: Visit, tmp_path: Path) -> None:
    (tmp_path / "plant").mkdir()
    with groundplan_up(tmp_path / "plant") as running:
        _story(running, visit, tmp_path)
