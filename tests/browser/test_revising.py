"""A map is changed by clicks: layers, an erased region, the comparison, two channels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from demo import steps
from demo.client import Client
from demo.hall import WALL_HEIGHT, Hall, synthetic_hall
from demo.running import Running, groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, rough_pose, scan_of_new_machine
from tests.browser.conftest import Visit
from worker.formats.pcd import read_pcd

SEED = 1
RECIPE = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}


@dataclass(frozen=True)
class Plant:
    """Hold a running service with a map of two revisions: the drawing, and a scanned machine on it."""

    running: Running
    admin: Client
    map_id: str
    hall: Hall

    def revision(self, n: int) -> dict[str, Any]:
        """Return a revision as the API tells it."""
        return dict(self.admin.get(f"/v1/maps/{self.map_id}/revisions/{n}"))


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Give service and worker with the two revisions, the first published."""
    hall = synthetic_hall(SEED)
    with groundplan_up(tmp_path_factory.mktemp("plant")) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 3")
        drawing = steps.read_drawing(admin, map_id, drawing_png(hall), clicked=known_length(hall))
        n = steps.build_revision(admin, map_id, drawing_id=drawing["id"], recipe=RECIPE)
        steps.publish(admin, map_id, n)
        scan = scan_of_new_machine(hall, seed=SEED)
        read = steps.read_scan(admin, map_id, ply_bytes(scan.cloud.points))
        rough = rough_pose(scan.T_map_scan, seed=SEED)
        placement = steps.place_scan(admin, read["id"], revision=n, rough=rough)
        assert steps.accept(admin, placement["id"]) == 2
        yield Plant(running, admin, map_id, hall)


def _tap(plan: Locator, extent: list[float], at: tuple[float, float]) -> None:
    """Tap a place of the map; `extent` is what the plan shows: least x, least -y, width, height [m]."""
    box = plan.bounding_box()
    assert box is not None
    x, y, wide, high = extent
    place = {"x": (at[0] - x) / wide * box["width"], "y": (-at[1] - y) / high * box["height"]}
    plan.click(position=place)


def _points_in(plant: Plant, n: int, folder: Path, corners: list[tuple[float, float]]) -> int:
    """Return how many points of a revision lie in a rectangle, between knee and wall height."""
    path = folder / f"{n}.pcd"
    url = f"/v1/maps/{plant.map_id}/revisions/{n}/artifacts/point-cloud.pcd"
    path.write_bytes(plant.admin.request("GET", url, expected=(200,)).content)
    points = read_pcd(path).points
    low, high = (tuple(pick(c[k] for c in corners) for k in (0, 1)) for pick in (min, max))
    inside = (points[:, :2] > low).all(axis=1) & (points[:, :2] < high).all(axis=1)
    return int((inside & (points[:, 2] > 0.3)).sum())


def _made(page: Page, n: int) -> None:
    page.get_by_role("button", name="Make the revision").click()
    expect(page.get_by_role("status").filter(has_text=f"Revision made: {n}")).to_be_visible()


def test_layers_and_a_region_are_changed_compared_and_published_to_both_channels(
    plant: Plant, visit: Visit, pictures: Path, tmp_path: Path
) -> None:
    watched = visit(plant.running.address)
    page = watched.page
    watched.sign_in(plant.running.admin_key)
    page.get_by_role("link", name="Hall 3").first.click()
    page.get_by_role("link", name="Change the map").click()
    layers = page.get_by_role("region", name="Layers")
    layers.get_by_role("button", name="Rename").click()
    page.get_by_role("dialog").get_by_label("Name").fill("press 12")
    page.get_by_role("button", name="Plan it").click()
    layers.get_by_role("button", name="Move", exact=True).click()
    page.get_by_role("dialog").get_by_label("x [m]").fill("-0.5")
    page.get_by_role("button", name="Plan it").click()
    watched.accessible()
    _made(page, 3)
    before, after = plant.revision(2)["layers"][0], plant.revision(3)["layers"][0]
    assert after["name"] == "press 12"
    assert after["T_map_scan"][0][3] == pytest.approx(before["T_map_scan"][0][3] - 0.5)

    outline = plant.hall.outline
    corner = [(outline.x0 - 0.4, outline.y0 - 0.4), (outline.x0 + 2.0, outline.y0 - 0.4),
              (outline.x0 + 2.0, outline.y0 + 2.0), (outline.x0 - 0.4, outline.y0 + 2.0)]  # fmt: skip
    plan = page.get_by_role("img", name="The map from above")
    extent = [float(value) for value in str(plan.get_attribute("viewBox")).split()]
    page.get_by_role("button", name="Erase a region").click()
    inside = [(max(extent[0] + 0.01, x), max(-extent[1] - extent[3] + 0.01, y)) for x, y in corner]
    for at in inside:
        _tap(plan, extent, at)
    page.get_by_role("button", name="Erase what is in it").click()
    page.get_by_label("Why").fill("the corner was rebuilt")
    page.screenshot(path=pictures / "revise.png")
    _made(page, 4)
    (region,) = plant.revision(4)["erased"]
    assert plant.revision(4)["reason"] == "the corner was rebuilt"
    tapped = region["region"]["within"]
    assert all(
        abs(a - b) < 0.1
        for told, at in zip(tapped, inside, strict=True)
        for a, b in zip(told, at, strict=True)
    )
    assert _points_in(plant, 3, tmp_path, tapped) > 100
    assert _points_in(plant, 4, tmp_path, tapped) == 0
    page.get_by_role("button", name="Bring back").click()
    _made(page, 5)
    assert _points_in(plant, 5, tmp_path, tapped) == _points_in(plant, 3, tmp_path, tapped)

    page.goto(f"{plant.running.address}/#/maps/{plant.map_id}/compare/2/4")
    expect(page.get_by_role("img", name="Red went, green came")).to_be_visible()
    told = page.get_by_role("region", name="What differs")
    expect(told.get_by_role("listitem")).to_have_count(3)
    expect(told.get_by_text("press 12").first).to_be_visible()
    page.get_by_label("Before and after").fill("30")
    watched.accessible()
    page.screenshot(path=pictures / "compare.png")

    page.get_by_role("link", name="Back").click()
    revisions = page.get_by_role("region", name="Revisions")
    row = revisions.get_by_role("listitem").filter(has_text="Revision 5").first
    row.get_by_role("button", name="Publish").click()
    page.get_by_role("button", name="First robots (canary)").click()
    page.get_by_role("dialog").get_by_role("button", name="Publish").click()
    expect(row.get_by_text("First robots (canary)")).to_be_visible()
    channels = plant.admin.get(f"/v1/maps/{plant.map_id}/channels")["channels"]
    assert {one["name"]: one["revision_n"] for one in channels} == {"stable": 1, "canary": 5}
    page.get_by_text("What was made from what").click()
    expect(page.locator(".graph circle")).to_have_count(5)
    watched.accessible()
    page.screenshot(path=pictures / "revisions.png")
    watched.clean()
