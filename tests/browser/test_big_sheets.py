"""The drawing page with a sheet of 65 megapixels: how soon it is seen, and how it pans and zooms."""

from __future__ import annotations

import io
import time
from pathlib import Path

import pytest
from PIL import Image
from playwright.sync_api import expect

from demo import steps
from demo.client import Client
from demo.hall import synthetic_hall
from demo.running import groundplan_up
from demo.sheet import drawing_png, known_length
from tests.browser.conftest import Visit

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

WIDTH, HEIGHT = 9300, 7000
LONG_TASKS = """
window.longest = 0;
new PerformanceObserver(list => {
  for (const task of list.getEntries()) window.longest = Math.max(window.longest, task.duration);
}).observe({ type: 'longtask' });
"""


def mosaic() -> bytes:
    """Return one sheet with as many halls on it as have room, the first in its corner, as PNG."""
    sheet = Image.new("L", (WIDTH, HEIGHT), 255)
    y = seed = 0
    while y < HEIGHT:
        x = row = 0
        while x < WIDTH:
            hall = Image.open(io.BytesIO(drawing_png(synthetic_hall(seed))))
            sheet.paste(hall, (x, y))
            x, row, seed = x + hall.width, max(row, hall.height), seed + 1
        y += row
    out = io.BytesIO()
    sheet.save(out, "PNG")
    return out.getvalue()


def test_a_sheet_of_65_megapixels_pans_and_zooms(visit: Visit, tmp_path: Path) -> None:
    with groundplan_up(tmp_path) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 3")
        began = time.perf_counter()
        drawing = steps.read_drawing(admin, map_id, mosaic(), clicked=known_length(synthetic_hall(0)))
        read_s = time.perf_counter() - began
        watched = visit(running.address)
        page = watched.page
        page.add_init_script(LONG_TASKS)
        watched.sign_in(running.admin_key)
        began = time.perf_counter()
        page.goto(f"{running.address}/#/maps/{map_id}/drawings/{drawing['id']}")
        canvas = page.locator("canvas.sheet[data-drawn]")
        expect(canvas).to_be_visible()
        first_s = time.perf_counter() - began
        expect(page.locator("canvas.sheet[data-settled=true]")).to_be_visible()
        loading_ms = page.evaluate("window.longest")
        page.evaluate("window.longest = 0")
        box = canvas.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        most = 0
        for wheel in (-900, -900, -900, 0, 900, 900):
            page.mouse.move(x, y)
            page.mouse.wheel(0, wheel)
            page.mouse.down()
            page.mouse.move(x - 250, y - 120, steps=40)
            page.mouse.up()
            expect(page.locator("canvas.sheet[data-settled=true]")).to_be_visible()
            most = max(most, int(str(canvas.get_attribute("data-tiles"))))
        moving_ms = page.evaluate("window.longest")
    print(f"\n{WIDTH * HEIGHT / 1e6:.0f} Mpx: read in {read_s:.0f} s, first picture after {first_s:.2f} s;")
    print(f"longest task {loading_ms:.0f} ms loading, {moving_ms:.0f} ms moving; {most} tiles held at most")
