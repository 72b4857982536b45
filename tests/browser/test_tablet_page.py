"""A worker sends a scan from a tablet over a bad network, watches it fit and takes it into the map."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from demo import steps
from demo.client import Client
from demo.hall import WALL_HEIGHT, synthetic_hall
from demo.running import Running, groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, scan_of_new_machine
from tests.bad_network import BadNetwork, bad_network
from tests.browser.conftest import Visit, Watched
from worker.geometry.lidar.tablet import TabletScan

SEED = 1
RECIPE = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}
RATE = 1.5e6
PIECE = 2 * 1024 * 1024
HEADERS = 60_000
TABLET = {"viewport": {"width": 1024, "height": 768}, "has_touch": True}


@dataclass(frozen=True)
class Plant:
    """Hold a running service with a map, and a scan of a machine that the map lacks."""

    running: Running
    admin: Client
    map_id: str
    scan: TabletScan

    def scan_file(self, *, times: int) -> bytes:
        """Return the scan as PLY, its points `times` as many: each a millimetre beside its like."""
        rng = np.random.default_rng(SEED)
        points = np.tile(self.scan.cloud.points, (times, 1))
        return ply_bytes(points + rng.normal(0.0, 0.001, points.shape))


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Give service and worker, with revision 1 of a hall built."""
    hall = synthetic_hall(SEED)
    with groundplan_up(tmp_path_factory.mktemp("plant")) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 3")
        drawing = steps.read_drawing(admin, map_id, drawing_png(hall), clicked=known_length(hall))
        steps.build_revision(admin, map_id, drawing_id=drawing["id"], recipe=RECIPE)
        yield Plant(running, admin, map_id, scan_of_new_machine(hall, seed=SEED))


def open_and_sign_in(watched: Watched, key: str) -> None:
    watched.page.goto(f"{watched.url}/tablet")
    watched.page.get_by_label("Your key").fill(key)
    watched.page.get_by_role("button", name="Sign in").tap()
    expect(watched.page.get_by_role("button", name="Begin")).to_be_visible()


def tap_plan(page: Page, at: tuple[float, float]) -> None:
    plan = page.get_by_role("img", name="Roughly where?")
    box = plan.bounding_box()
    assert box is not None
    left, top, wide, high = (float(part) for part in str(plan.get_attribute("viewBox")).split())
    zoom = min(box["width"] / wide, box["height"] / high)
    x = box["width"] / 2 + (at[0] - left - wide / 2) * zoom
    y = box["height"] / 2 + (-at[1] - top - high / 2) * zoom
    plan.tap(position={"x": x, "y": y})


def send_file(page: Page, name: str, content: bytes) -> None:
    page.get_by_role("button", name="Hall 3").tap()
    file = {"name": name, "mimeType": "application/octet-stream", "buffer": content}
    page.get_by_label("Take or choose the scan").set_input_files([file])
    page.get_by_role("button", name="I do not know").tap()


def until_sent(network: BadNetwork, size: float, *, patience_s: float = 60.0) -> None:
    until = time.monotonic() + patience_s
    while network.sent < size:
        assert time.monotonic() < until, f"{network.sent} bytes went through"
        time.sleep(0.02)


def test_a_scan_is_sent_over_a_bad_network_watched_and_taken(
    plant: Plant, visit: Visit, pictures: Path
) -> None:
    content = plant.scan_file(times=max(2, int(9e6 / (12 * len(plant.scan.cloud.points)))))
    key = plant.admin.post("/v1/keys", {"name": "pad", "role": "tablet", "map_ids": [plant.map_id]})["key"]
    with bad_network(plant.running.address, rate=RATE) as network:
        watched = visit(network.url, **TABLET)
        page = watched.page
        open_and_sign_in(watched, key)
        watched.accessible()
        page.screenshot(path=pictures / "tablet-how.png")
        page.get_by_role("button", name="Begin").tap()
        page.get_by_role("button", name="Hall 3").tap()
        file = {"name": "press.ply", "mimeType": "application/octet-stream", "buffer": content}
        page.get_by_label("Take or choose the scan").set_input_files([file])
        x, y, _ = plant.scan.T_map_scan.translation
        yaw = plant.scan.T_map_scan.rpy[2]
        tap_plan(page, (x, y))
        tap_plan(page, (x + 2 * np.cos(yaw), y + 2 * np.sin(yaw)))
        watched.accessible()
        page.screenshot(path=pictures / "tablet-where.png")
        before = network.sent
        page.get_by_role("button", name="Send", exact=True).tap()
        until_sent(network, before + 0.3 * len(content))
        network.cut()
        until_sent(network, before + 0.6 * len(content))
        page.reload()
        until_sent(network, before + 0.8 * len(content))
        network.cut()
        take = page.get_by_role("button", name="Yes, take it")
        expect(take).to_be_visible()
        assert network.cuts == 2
        assert network.sent - before < len(content) + PIECE + 20 * HEADERS
        watched.accessible()
        page.screenshot(path=pictures / "tablet-fit.png")
        take.tap()
        expect(page.get_by_text("Revision made:")).to_be_visible()
    (scan,) = plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"]
    assert scan["sha256"] == hashlib.sha256(content).hexdigest()
    revisions = plant.admin.get(f"/v1/maps/{plant.map_id}/revisions")["items"]
    assert sorted(one["n"] for one in revisions if one["status"] == "ready") == [1, 2]
    (placement,) = plant.admin.get(f"/v1/scans/{scan['id']}/placements")["items"]
    found = steps.pose_of(placement)
    off = plant.scan.T_map_scan.inverse() @ found
    assert np.linalg.norm(off.translation) < 0.1
    # the cuts, and the lock of a fallen connection, as the browser tells them
    watched.faults = [one for one in watched.faults if not one.startswith("Failed to load resource")]
    watched.clean()


def test_a_scan_given_up_is_sent_no_further_and_does_not_come_back(plant: Plant, visit: Visit) -> None:
    known = {one["id"] for one in plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"]}
    unwanted = plant.scan_file(times=max(4, int(16e6 / (12 * len(plant.scan.cloud.points)))))
    wanted = plant.scan_file(times=1)
    with bad_network(plant.running.address, rate=RATE) as network:
        watched = visit(network.url, **TABLET)
        page = watched.page
        open_and_sign_in(watched, plant.running.admin_key)
        page.get_by_role("button", name="Begin").tap()
        before = network.sent
        send_file(page, "unwanted.ply", unwanted)
        until_sent(network, before + 0.2 * len(unwanted))
        with page.expect_response(lambda said: said.request.method == "DELETE" and said.status == 204):
            page.get_by_role("button", name="Stop and forget it").tap()
        send_file(page, "wanted.ply", wanted)
        expect(page.get_by_role("link", name="Move it")).to_be_visible()
        assert network.sent - before < 0.2 * len(unwanted) + len(wanted) + PIECE + 20 * HEADERS
        page.get_by_role("button", name="Decide later").tap()
        expect(page.get_by_role("heading", name="Which map?")).to_be_visible()
        page.reload()
        expect(page.get_by_role("button", name="Begin")).to_be_visible()
    scans = plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"]
    (sent,) = (one for one in scans if one["id"] not in known)
    assert sent["sha256"] == hashlib.sha256(wanted).hexdigest()


def test_scans_wait_in_line_and_the_line_outlives_the_page(plant: Plant, visit: Visit) -> None:
    known = {one["id"] for one in plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"]}
    times = max(2, int(4e6 / (12 * len(plant.scan.cloud.points))))
    contents = [plant.scan_file(times=times + n) for n in range(3)]
    digests = [hashlib.sha256(content).hexdigest() for content in contents]
    with bad_network(plant.running.address, rate=RATE / 20) as network:
        watched = visit(network.url, **TABLET)
        page = watched.page
        open_and_sign_in(watched, plant.running.admin_key)
        page.get_by_role("button", name="Begin").tap()
        before = network.sent
        for n, content in enumerate(contents):
            send_file(page, f"room {n}.ply", content)
            page.get_by_role("button", name="Send another").tap()
        cards = page.locator("section.card")
        expect(cards.filter(has_text="Waits until the one before is sent")).to_have_count(2)
        network.rate = RATE
        cards.filter(has_text="room 1.ply").get_by_role("button", name="Stop and forget it").tap()
        until_sent(network, before + 0.5 * len(contents[0]))
        page.reload()
        expect(cards.filter(has_text="Waits until the one before is sent")).to_have_count(1)
        expect(page.get_by_role("link", name="Move it")).to_have_count(2)
        assert network.sent - before < len(contents[0]) + len(contents[2]) + PIECE + 40 * HEADERS
        watched.accessible()
        for _ in range(2):
            page.get_by_role("button", name="Decide later").first.tap()
        expect(page.get_by_role("heading", name="Which map?")).to_be_visible()
        watched.faults = [one for one in watched.faults if not one.startswith("Failed to load resource")]
        watched.clean()
    sent = [
        one for one in plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"] if one["id"] not in known
    ]
    assert [one["sha256"] for one in sorted(sent, key=lambda one: one["id"])] == [digests[0], digests[2]]


@pytest.mark.benchmark
def test_three_hundred_megabytes_through_a_network_that_falls_every_eighty_megabytes(
    plant: Plant, visit: Visit, tmp_path: Path
) -> None:
    path, size = tmp_path / "large.ply", 300_000_000
    path.write_bytes(plant.scan_file(times=1)[:10_000] + np.random.default_rng(0).bytes(size - 10_000))
    with bad_network(plant.running.address, rate=4e6, cut_every=80_000_000) as network:
        watched = visit(network.url, **TABLET)
        page = watched.page
        open_and_sign_in(watched, plant.running.admin_key)
        page.get_by_role("button", name="Begin").tap()
        page.get_by_role("button", name="Hall 3").tap()
        page.get_by_label("Take or choose the scan").set_input_files(path)
        before, begun = network.sent, time.monotonic()
        page.get_by_role("button", name="I do not know").tap()
        until_sent(network, before + 0.5 * size, patience_s=300)
        page.reload()
        expect(page.get_by_role("alert")).to_be_visible(timeout=600_000)  # what was sent is no scan
        took, cuts, sent = time.monotonic() - begun, network.cuts, network.sent - before
    newest = max(plant.admin.get(f"/v1/maps/{plant.map_id}/scans")["items"], key=lambda one: one["id"])
    assert newest["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    twice = (sent - size) / PIECE
    print(f"\n{size / 1e6:.0f} MB in {took:.0f} s, {cuts} cuts and a reload; {twice:.2f} pieces sent twice")
    assert cuts >= 3
    assert twice < 1
