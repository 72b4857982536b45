"""The placement page with large maps: few points are held, and the page stays quick."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Locator, Page, expect
from scipy.spatial import cKDTree

from demo import steps
from demo.client import Client
from demo.hall import WALL_HEIGHT, synthetic_hall
from demo.running import Running, groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, scan_of_new_machine
from tests.browser.conftest import Visit, Watched

SEED = 1
MOST = 200_000
LONG_TASKS = """
window.longest = 0;
new PerformanceObserver(list => {
  for (const task of list.getEntries()) window.longest = Math.max(window.longest, task.duration);
}).observe({ type: 'longtask' });
"""


@dataclass(frozen=True)
class Plant:
    """Hold a running service with a map, and a scan that was read."""

    running: Running
    admin: Client
    map_id: str
    drawing_id: str
    scan_id: str

    def build(self, voxel_m: float) -> tuple[int, int]:
        """Return the number of a new revision, and how many points it has."""
        recipe = {"voxel_size_m": voxel_m, "wall_height_m": WALL_HEIGHT, "floor": True, "ceiling": True}
        n = steps.build_revision(self.admin, self.map_id, drawing_id=self.drawing_id, recipe=recipe)
        head = self.admin.request(
            "GET",
            f"/v1/maps/{self.map_id}/revisions/{n}/artifacts/point-cloud.pcd",
            expected=(200,),
        ).content[:400]
        return n, int(head.split(b"POINTS ")[1].split()[0])

    def cloud(self, n: int) -> NDArray[np.float64]:
        """Return the points (N, 3) of a revision [m]."""
        where = f"/v1/maps/{self.map_id}/revisions/{n}/artifacts/point-cloud.pcd"
        content = self.admin.request("GET", where, expected=(200,)).content
        records = content[content.index(b"DATA binary\n") + 12 :]
        return np.frombuffer(records, dtype="<f4").reshape(-1, 4)[:, :3].astype(np.float64)


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Give service and worker with a read drawing and a read scan."""
    hall = synthetic_hall(SEED)
    with groundplan_up(tmp_path_factory.mktemp("plant")) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 3")
        drawing = steps.read_drawing(admin, map_id, drawing_png(hall), clicked=known_length(hall))
        scan = steps.read_scan(admin, map_id, ply_bytes(scan_of_new_machine(hall, seed=SEED).cloud.points))
        yield Plant(running, admin, map_id, drawing["id"], scan["id"])


def _open(plant: Plant, watched: Watched) -> float:
    """Return after how many seconds the first picture is there."""
    page = watched.page
    page.add_init_script(LONG_TASKS)
    watched.sign_in(plant.running.admin_key)
    begun = time.perf_counter()
    page.goto(f"{plant.running.address}/#/maps/{plant.map_id}/scans/{plant.scan_id}")
    expect(page.locator("canvas.cloud[data-drawn]")).to_be_visible()
    return time.perf_counter() - begun


def _points(page: Page) -> int:
    return int(str(page.locator("canvas.cloud").get_attribute("data-points")))


def _settled(page: Page) -> Locator:
    canvas = page.locator("canvas.cloud[data-settled=true]")
    expect(canvas).to_be_visible()
    return canvas


def test_of_a_large_cloud_few_points_are_held(plant: Plant, visit: Visit) -> None:
    assert plant.build(0.04)[1] > MOST
    watched = visit(plant.running.address)
    _open(plant, watched)
    for button in ("In 3-D", "From above"):
        watched.page.get_by_role("button", name=button).click()
        _settled(watched.page)
        assert MOST / 10 < _points(watched.page) <= MOST
    height = watched.page.get_by_label("Height [m]")
    height.fill("1.25")
    height.blur()
    expect(height).to_have_value("1.25")
    watched.clean()


def test_the_point_clicked_on_is_one_of_the_whole_cloud(plant: Plant, visit: Visit, pictures: Path) -> None:
    n, built = plant.build(0.03)
    cloud = plant.cloud(n)
    assert len(cloud) == built > 2 * MOST
    watched = visit(plant.running.address)
    page = watched.page
    watched.sign_in(plant.running.admin_key)
    page.goto(f"{plant.running.address}/#/maps/{plant.map_id}/revisions/{n}")
    _settled(page)
    assert _points(page) <= MOST
    watched.accessible()
    assert _coloured(_settled(page)) > 0.05
    page.screenshot(path=pictures / "revision.png")
    page.get_by_role("button", name="From above").click()
    box = _settled(page).bounding_box()
    assert box is not None
    assert _coloured(_settled(page)) > 0.01
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    middle, span = 0.5 * (low + high), high - low
    metres = 1.1 * max(span[1], span[0] * box["height"] / box["width"]) / box["height"]
    top = cloud[cloud[:, 2] > high[2] - 0.02]
    for place in top[np.random.default_rng(1).integers(0, len(top), 3)]:
        at = (place[:2] - middle[:2]) * (1.0, -1.0) / metres + (box["width"] / 2, box["height"] / 2)
        x, y = box["x"] + round(float(at[0])), box["y"] + round(float(at[1]))
        said = page.get_by_label("Point picked")
        before = str(said.text_content())
        page.mouse.click(x, y)
        expect(said).not_to_have_text(before)
        picked = np.array([float(part) for part in str(said.text_content()).removesuffix(" m").split(",")])
        assert cKDTree(cloud).query(picked)[0] < 0.002
        seen = np.array([x - box["x"] - box["width"] / 2, y - box["y"] - box["height"] / 2])
        ray = middle[:2] + seen * (metres, -metres)
        assert np.hypot(*(picked[:2] - ray)) < np.hypot(*(top[:, :2] - ray).T).min() + 0.01
        assert picked[2] > high[2] - 0.1
    watched.clean()


def _coloured(canvas: Locator) -> float:
    """Return the share of the picture that shows points."""
    picture = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB")).astype(int)
    return float((picture.max(axis=2) - picture.min(axis=2) > 20).mean())


@pytest.mark.benchmark
@pytest.mark.parametrize("voxel_m", [0.07, 0.016])
def test_the_page_stays_quick(plant: Plant, visit: Visit, voxel_m: float) -> None:
    _, built = plant.build(voxel_m)
    watched = visit(plant.running.address)
    page = watched.page
    first_s = _open(plant, watched)
    box = page.locator("canvas.cloud").bounding_box()
    assert box is not None
    loading_ms = page.evaluate("window.longest")
    for button in ("From above", "In 3-D"):
        page.get_by_role("button", name=button).click()
        page.evaluate("window.longest = 0")
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        page.mouse.down()
        for step in range(60):
            page.mouse.move(box["x"] + box["width"] / 2 + 3 * step, box["y"] + box["height"] / 2 + step)
        page.mouse.up()
        _settled(page)
        dragged_ms = page.evaluate("window.longest")
        print(f"\n{built:,} points, {_points(page):,} held: first picture after {first_s:.2f} s,"
              f" longest task {loading_ms:.0f} ms; {button}: {dragged_ms:.0f} ms dragging")  # fmt: skip
