"""A drawing is given its scale by two clicks, corrected by lasso and by a drawn wall, and built."""

from __future__ import annotations

import io
import math
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Locator, Page, expect

from demo import steps
from demo.client import Client
from demo.hall import Hall, synthetic_hall
from demo.running import Running, groundplan_up
from demo.sheet import drawing_png, known_length
from tests.browser.conftest import Visit, Watched
from tests.patience import PATIENCE_S

SEED = 5
_NEAR = 0.01
At = tuple[float, float]


@dataclass(frozen=True)
class Plant:
    """Hold a running service with an empty map, and a sheet whose scale is known here."""

    running: Running
    admin: Client
    map_id: str
    hall: Hall

    def drawing(self) -> dict[str, Any]:
        """Return the only drawing as the API tells it."""
        (found,) = self.admin.get(f"/v1/maps/{self.map_id}/drawings")["items"]
        return dict(found)

    def features(self, name: str) -> list[dict[str, Any]]:
        """Return the features of `walls` or `removed`."""
        return list(self.admin.get(self.drawing()["files"][name])["features"])


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    """Give service and worker with one map."""
    with groundplan_up(tmp_path_factory.mktemp("plant")) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 5")
        yield Plant(running, admin, map_id, synthetic_hall(SEED))


class Sheet:
    """Turn places of frame `drawing` into places on the canvas."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.canvas: Locator = page.locator("canvas.sheet[data-drawn]")

    def on_page(self, at: At) -> At:
        """Return where in the window a place is."""
        x, y, zoom = (float(part) for part in str(self.canvas.get_attribute("data-view")).split())
        box = self.canvas.bounding_box()
        assert box is not None
        middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        return middle[0] + (at[0] - x) * zoom, middle[1] - (at[1] - y) * zoom

    def click(self, at: At) -> None:
        """Click a place."""
        self.page.mouse.click(*self.on_page(at))

    def lasso(self, ring: list[At]) -> None:
        """Draw around places."""
        self.page.mouse.move(*self.on_page(ring[0]))
        self.page.mouse.down()
        for at in [*ring[1:], ring[0]]:
            self.page.mouse.move(*self.on_page(at), steps=4)
        self.page.mouse.up()

    def go_to(self, at: At) -> None:
        """Move the sheet with the arrows until a place is in the middle, to a hundredth of the canvas."""
        until = time.monotonic() + PATIENCE_S
        while max(abs(part) for part in self._away(at)) > _NEAR:
            assert time.monotonic() < until, self._away(at)
            for share, (less, more) in zip(self._away(at), (("Left", "Right"), ("Up", "Down")), strict=True):
                tens, ones = divmod(round(abs(share) * 100), 10)
                arrow = f"Arrow{more if share > 0 else less}"
                for key in [arrow] * tens + [f"Shift+{arrow}"] * ones:
                    self.page.keyboard.press(key)

    def _away(self, at: At) -> At:
        """Return how far a place is from the middle of the canvas, in shares of it, once that is drawn."""
        self.page.evaluate(
            "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        box = self.canvas.bounding_box()
        assert box is not None
        x, y = self.on_page(at)
        return (x - box["x"]) / box["width"] - 0.5, (y - box["y"]) / box["height"] - 0.5

    def inked(self) -> NDArray[np.bool_]:
        """Return which pixels of the canvas, buttons on it left out, are not bare paper."""
        pixels = np.asarray(Image.open(io.BytesIO(self.canvas.screenshot())).convert("RGB"))
        return np.asarray(pixels.min(axis=-1)[70:-5, 5:-5] < 200)

    def dark(self) -> int:
        """Return how many pixels are as dark as walls."""
        pixels = np.asarray(Image.open(io.BytesIO(self.canvas.screenshot())).convert("RGB"))
        return int((pixels.max(axis=-1) < 90).sum())


def box_around(feature: dict[str, Any], *, share: float = 0.02) -> list[At]:
    """Return the corners of a box around a wall's faces, a little larger."""
    points = np.array([at for face in feature["properties"]["faces"] for at in face])
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    room = share * max(x1 - x0, y1 - y0)
    return [(x0 - room, y0 - room), (x1 + room, y0 - room), (x1 + room, y1 + room), (x0 - room, y1 + room)]


def look_below_the_strokes(page: Page, sheet: Sheet) -> None:
    """Hide every stroke: what is left is the sheet, where the strokes were, and that can be hidden too."""
    expect(page.locator("canvas.sheet[data-settled=true]")).to_be_visible()
    strokes_too = sheet.inked()
    boxes = page.get_by_role("region", name="Kept and set aside").get_by_role("checkbox")
    for box in boxes.all():
        box.uncheck()
    page.wait_for_timeout(200)
    alone = sheet.inked()
    assert alone.sum() > 2000
    assert (alone & strokes_too).sum() > 0.97 * alone.sum()
    page.get_by_role("button", name="The sheet itself").click()
    expect(page.locator("canvas.sheet[data-tiles=none]")).to_be_visible()
    assert not sheet.inked().any()
    page.get_by_role("button", name="The sheet itself").click()
    for box in boxes.all():
        box.check()


def length(feature: dict[str, Any]) -> float:
    a, b = feature["geometry"]["coordinates"][0], feature["geometry"]["coordinates"][-1]
    return math.hypot(b[0] - a[0], b[1] - a[1])


def save(page: Page) -> None:
    page.get_by_role("button", name="Save and read again").click()
    until_read(page)


def until_read(page: Page) -> None:
    save = page.get_by_role("button", name="Save and read again")
    expect(save).to_be_disabled()
    expect(page.locator(".progress")).to_have_count(0)
    expect(save).to_be_disabled()


def opened(plant: Plant, visit: Visit, name: str) -> tuple[Plant, Watched]:
    """Return a new map with the drawing, its scale given, and the page that corrects it."""
    here = replace(plant, map_id=steps.make_map(plant.admin, site="Nagoya", name=name))
    sheet, clicked = drawing_png(plant.hall), known_length(plant.hall)
    drawing = steps.read_drawing(plant.admin, here.map_id, sheet, clicked=clicked)
    watched = visit(plant.running.address)
    watched.sign_in(plant.running.admin_key)
    watched.page.goto(f"{plant.running.address}/#/maps/{here.map_id}/drawings/{drawing['id']}")
    expect(Sheet(watched.page).canvas).to_be_visible()
    return here, watched


def test_a_drawing_is_scaled_corrected_and_built_by_clicks(
    plant: Plant, visit: Visit, pictures: Path
) -> None:
    watched = visit(plant.running.address)
    page = watched.page
    watched.sign_in(plant.running.admin_key)
    page.get_by_role("link", name="Hall 5").first.click()
    drawings = page.get_by_role("region", name="Drawings")
    file = {"name": "hall.png", "mimeType": "image/png", "buffer": drawing_png(plant.hall)}
    drawings.get_by_label("Send a drawing").set_input_files([file])
    drawings.get_by_role("link", name="Correct").click()
    sheet = Sheet(page)
    expect(sheet.canvas).to_be_visible()
    watched.accessible()
    look_below_the_strokes(page, sheet)

    clicked = known_length(plant.hall)
    before = plant.drawing()["reading"]
    factor, top = before["scale"]["metres_per_unit"] or 1.0, before["drawing_top"]
    page.get_by_role("button", name="Set the scale").click()
    for x, y in ((clicked.x1, clicked.y1), (clicked.x2, clicked.y2)):
        sheet.click((x * factor, top - y * factor))
    page.get_by_label("Length [m]").fill(f"{2 * clicked.length_m}")
    page.get_by_role("button", name="Apply").click()
    scale = page.get_by_role("region", name="Scale")
    expect(scale.get_by_text("Given", exact=True)).to_be_visible()
    given = plant.drawing()["reading"]["scale"]["metres_per_unit"]
    truth = clicked.length_m / math.hypot(clicked.x2 - clicked.x1, clicked.y2 - clicked.y1)
    assert given == pytest.approx(2 * truth, rel=0.01)
    page.get_by_role("button", name="Set the scale").click()
    factor, top = given, plant.drawing()["reading"]["drawing_top"]
    for x, y in ((clicked.x1, clicked.y1), (clicked.x2, clicked.y2)):
        sheet.click((x * factor, top - y * factor))
    page.get_by_label("Length [m]").fill(f"{clicked.length_m}")
    page.get_by_role("button", name="Apply").click()
    expect(scale.get_by_text(re.compile(r"^0\.0(199|200)"))).to_be_visible()
    assert plant.drawing()["reading"]["scale"]["metres_per_unit"] == pytest.approx(truth, rel=0.01)

    walls = plant.features("walls")
    inner = min((one for one in walls if one["properties"].get("faces")), key=length)
    name = inner["properties"]["id"]
    dark = sheet.dark()
    page.get_by_role("button", name="Set aside", exact=True).click()
    sheet.lasso(box_around(inner))
    save(page)
    left = plant.features("walls")
    assert name not in {one["properties"]["id"] for one in left}
    kept = sum(one["properties"]["layer"] == "wall" for one in left)
    expect(page.get_by_text(f"wall ({kept})")).to_be_visible()
    assert sheet.dark() < dark
    page.screenshot(path=pictures / "drawing.png")
    page.get_by_role("button", name="Undo").click()
    save(page)
    assert name in {one["properties"]["id"] for one in plant.features("walls")}

    middle = (plant.drawing()["reading"]["sheet"][0] / 2, plant.drawing()["reading"]["sheet"][1] / 2)
    ends = [(middle[0] - 2.0, middle[1]), (middle[0] + 2.0, middle[1])]
    page.get_by_role("button", name="Draw a wall").click()
    for end in ends:
        sheet.click(end)
    save(page)
    lines = [np.array(one["geometry"]["coordinates"]) for one in plant.features("walls")
             if one["geometry"]["type"] == "LineString"]  # fmt: skip
    assert any(np.abs(line[[0, -1]] - np.array(ends)).max() < 0.15 for line in lines if len(line) == 2)

    page.get_by_label("Voxel size").fill("0.2")
    page.get_by_role("button", name="Build a revision").click()
    expect(page.get_by_role("status").filter(has_text="Revision made: 1")).to_be_visible()
    recipe = plant.admin.get(f"/v1/maps/{plant.map_id}/revisions/1")["recipe"]
    assert (recipe["voxel_size_m"], recipe["floor"]) == (0.2, True)
    watched.accessible()
    watched.clean()


def test_walls_are_erased_kept_and_left_out_by_drawing_around_them(plant: Plant, visit: Visit) -> None:
    here, watched = opened(plant, visit, "Hall 6")
    page, sheet = watched.page, Sheet(watched.page)
    page.get_by_role("button", name="Light or dark").click()
    watched.accessible()
    set_scale_in_feet(page, sheet, here)

    walls = {one["properties"]["id"]: one for one in here.features("walls")}
    inner = min((one for one in walls.values() if one["properties"].get("faces")), key=length)
    name = inner["properties"]["id"]
    page.get_by_role("button", name="Erase walls").click()
    sheet.lasso(box_around(inner))
    page.keyboard.press("Control+z")
    expect(page.get_by_role("button", name="Save and read again")).to_be_disabled()
    page.keyboard.press("Control+y")
    save(page)
    assert set(walls) - {one["properties"]["id"] for one in here.features("walls")} == {name}
    page.get_by_role("button", name="Keep as walls").click()
    sheet.lasso(box_around(inner))
    save(page)
    kept = [one for one in here.features("walls") if one["geometry"]["type"] == "LineString"]
    ends = np.array(inner["geometry"]["coordinates"])
    near = [np.abs(np.array(one["geometry"]["coordinates"]) - ends.mean(axis=0)).max() for one in kept]
    assert min(near) < length(inner)
    for _ in range(2):
        page.keyboard.press("Control+z")
    save(page)
    assert {one["properties"]["id"] for one in here.features("walls")} == set(walls)

    wide, high = here.drawing()["reading"]["sheet"]
    half = [
        (wide * 0.01, high * 0.01),
        (wide / 2, high * 0.01),
        (wide / 2, high * 0.99),
        (wide * 0.01, high * 0.99),
    ]
    for tool, side in (("Only this part", -1.0), ("Not this part", 1.0)):
        page.get_by_role("button", name=tool).click()
        sheet.lasso(half)
        save(page)
        middles = [np.mean(np.array(one["geometry"]["coordinates"]).reshape(-1, 2), axis=0)
                   for one in here.features("walls") if one["geometry"]["type"] == "LineString"]  # fmt: skip
        assert 2 <= len(middles) < len(walls)
        assert all(side * (x - wide / 2) > -0.1 * wide for x, _ in middles)
        page.get_by_role("button", name="Undo").click()
    save(page)
    watched.clean()


def test_a_drawing_is_corrected_with_the_keyboard_alone(plant: Plant, visit: Visit) -> None:
    here, watched = opened(plant, visit, "Hall 7")
    page, sheet = watched.page, Sheet(watched.page)
    walls = {one["properties"]["id"]: one for one in here.features("walls")}
    outlined = (one for one in walls.values() if one["properties"].get("faces") and length(one) > 2.0)
    inner = min(outlined, key=length)
    choose(page, "button", "Erase walls")
    choose(page, "application", "Correct the drawing")
    for _ in range(8):
        page.keyboard.press("+")
    corners = box_around(inner, share=0.05)
    sheet.go_to(corners[2])
    page.keyboard.press("Enter")
    page.keyboard.press("Escape")
    for corner in corners:
        sheet.go_to(corner)
        page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    choose(page, "button", "Draw a wall")
    choose(page, "application", "Correct the drawing")
    wide, high = here.drawing()["reading"]["sheet"]
    ends = [(wide / 2 - 2.0, high / 2), (wide / 2 + 2.0, high / 2)]
    for end in ends:
        sheet.go_to(end)
        page.keyboard.press("Enter")
    watched.accessible()
    choose(page, "button", "Save and read again")
    until_read(page)
    now = here.features("walls")
    gone = set(walls) - {one["properties"]["id"] for one in now}
    assert inner["properties"]["id"] in gone
    assert len(gone) < 4, "the walls that it meets are cut, too, no others"
    drawn = [np.array(one["geometry"]["coordinates"]) for one in now
             if one["geometry"]["type"] == "LineString" and one["properties"]["id"] not in walls]  # fmt: skip
    assert any(np.abs(line[[0, -1]] - np.array(ends)).max() < 0.3 for line in drawn if len(line) == 2)
    watched.clean()


def choose(page: Page, role: str, name: str) -> None:
    """Go to what is named with the tabulator, and press it if it is a button."""
    here = page.get_by_role(role, name=name)  # type: ignore[arg-type]  # two roles, given as text
    for _ in range(80):
        page.keyboard.press("Tab")
        if here.evaluate("it => it === document.activeElement"):
            break
    else:
        pytest.fail(f"the tabulator does not lead to {name}")
    if role == "button":
        page.keyboard.press("Enter")


def set_scale_in_feet(page: Page, sheet: Sheet, plant: Plant) -> None:
    """Set the scale to three times the true one, told in feet, and back."""
    clicked = known_length(plant.hall)
    truth = clicked.length_m / math.hypot(clicked.x2 - clicked.x1, clicked.y2 - clicked.y1)
    for times in (3.0, 1.0):
        reading = plant.drawing()["reading"]
        factor, top = reading["scale"]["metres_per_unit"], reading["drawing_top"]
        page.get_by_role("button", name="Set the scale").click()
        for x, y in ((clicked.x1, clicked.y1), (clicked.x2, clicked.y2)):
            sheet.click((x * factor, top - y * factor))
        page.get_by_label("Unit of the length").select_option("ft")
        page.get_by_label("Length [ft]").fill(f"{times * clicked.length_m / 0.3048:.4f}")
        page.get_by_role("button", name="Apply").click()
        shown = re.compile(rf"^{times * truth:.5g}"[:6].replace(".", r"\."))
        region = page.get_by_role("region", name="Scale")
        expect(region.get_by_text(shown)).to_be_visible()
        now = plant.drawing()["reading"]["scale"]["metres_per_unit"]
        assert now == pytest.approx(times * truth, rel=0.01)
