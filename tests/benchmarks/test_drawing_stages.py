"""What each stage of reading a large sheet costs in time and memory, beside a floor that nobody can beat."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from service.domain.bounds import Bounds
from worker.formats.raster import load_sheet
from worker.geometry.drawing.raster.ink import drop_dust, find_ink
from worker.geometry.drawing.raster.read import read_raster
from worker.geometry.drawing.raster.strokes import find_strokes
from worker.geometry.drawing.scale.decision import given

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(1200)]

ROUNDS = 5
DPI = 300
A0_MM = (1189, 841)
SCALE = 50
METRES_PER_PX = 0.0254 / DPI * SCALE
STAGES = ("floor", "load", "ink", "strokes", "walls")


@pytest.fixture(scope="session")
def a0_sheet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a generated hall of 59 x 42 m at 1:50 on A0: walls, doors, texts, hatches, furniture, a frame."""
    path = tmp_path_factory.mktemp("sheets") / "a0.png"
    cv2.imwrite(str(path), draw_hall(np.random.default_rng(1)))
    return path


def draw_hall(rng: np.random.Generator) -> np.ndarray:
    """Return the A0 sheet as (H, W) grey."""
    width, height = (round(mm / 25.4 * DPI) for mm in A0_MM)
    sheet = np.full((height, width), 255, dtype=np.uint8)
    cv2.rectangle(sheet, (200, 200), (width - 200, height - 200), 0, 8)
    room = round(6.0 / METRES_PER_PX)
    wall = round(0.24 / METRES_PER_PX)
    for x in range(600, width - 600 - room, room):
        for y in range(600, height - 600 - room, room):
            _draw_room(sheet, (x, y), room, wall, rng)
    return sheet


def _draw_room(
    sheet: np.ndarray, corner: tuple[int, int], room: int, wall: int, rng: np.random.Generator
) -> None:
    x, y = corner
    cv2.rectangle(sheet, (x, y), (x + room, y + room), 0, 6)
    cv2.rectangle(sheet, (x + wall, y + wall), (x + room - wall, y + room - wall), 0, 6)
    for row in range(12):
        words = "".join(rng.choice(list("ABCDEFGHIJKLMN 0123456789"), 24))
        at = (x + wall + 60, y + wall + 120 + 50 * row)
        cv2.putText(sheet, words, at, cv2.FONT_HERSHEY_SIMPLEX, 1.1, 0, 3, cv2.LINE_AA)
    low = y + room // 2
    for step in range(0, room // 3, 16):
        cv2.line(sheet, (x + 200 + step, low), (x + 200 + step + 300, low + 300), 90, 2, cv2.LINE_AA)
    for k in range(4):
        at = (x + room // 2 + k * 90, y + room - wall - 260)
        cv2.rectangle(sheet, at, (at[0] + 70, at[1] + 160), 60, 2)
    cv2.line(sheet, (x, y - 40), (x + room, y - 40), 0, 2)


def stages(path: Path, metres_per_px: float) -> Iterator[tuple[str, Callable[[], object]]]:
    """Give the name and the work of each stage; a stage takes what the last one left."""

    def floor() -> None:
        pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        assert pixels is not None
        cv2.threshold(pixels, 128, 255, cv2.THRESH_BINARY)

    yield "floor", floor
    kept: dict[str, object] = {}

    def load() -> None:
        kept["grey"] = load_sheet(path, bounds=Bounds()).grey

    def ink() -> None:
        kept["ink"] = drop_dust(find_ink(kept["grey"], metres_per_px))[0]  # type: ignore[arg-type]

    def strokes() -> None:
        find_strokes(kept["ink"], kept["ink"].mask)  # type: ignore[arg-type, attr-defined]

    def walls() -> None:
        kept.pop("ink", None)
        read_raster(kept["grey"], scale=given(metres_per_px))  # type: ignore[arg-type]

    yield from (("load", load), ("ink", ink), ("strokes", strokes), ("walls", walls))


def peak_kib() -> int:
    """Return the most memory that this process held so far; `ru_maxrss` would begin with its parent's."""
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])


def measure(path: Path, metres_per_px: float, last: str) -> dict[str, object]:
    """Return the times of every stage up to the last, and the peak memory of this process after each."""
    times: dict[str, float] = {}
    peaks: dict[str, int] = {}
    before = peak_kib()
    for name, work in stages(path, metres_per_px):
        spans = []
        for _ in range(ROUNDS + 1 if last == "walls" else 1):
            begun = time.perf_counter()
            work()
            spans.append(time.perf_counter() - begun)
        times[name] = statistics.median(spans[1:] or spans)
        peaks[name] = peak_kib()
        if name == last:
            break
    return {"times": times, "peak_kib": peaks[last], "before_kib": before}


def in_child(path: Path, metres_per_px: float, last: str) -> dict[str, dict[str, float] | int]:
    """Return what `measure` finds in a process of its own."""
    code = (
        "import json, sys; from pathlib import Path\n"
        "from tests.benchmarks.test_drawing_stages import measure\n"
        "print(json.dumps(measure(Path(sys.argv[1]), float(sys.argv[2]), sys.argv[3])))\n"
    )
    command = [sys.executable, "-c", code, str(path), repr(metres_per_px), last]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    found: dict[str, dict[str, float] | int] = json.loads(done.stdout)
    return found


def report(name: str, path: Path, metres_per_px: float) -> None:
    """Print the table of one sheet."""
    pixels = load_sheet(path).grey.size
    times = in_child(path, metres_per_px, "walls")["times"]
    assert isinstance(times, dict)
    print(f"\n{name}: {pixels / 1e6:.0f} Mpx; warm, median of {ROUNDS}; peak of a process that ends there")
    for stage in STAGES:
        child = in_child(path, metres_per_px, stage)
        peak, before = child["peak_kib"], child["before_kib"]
        assert isinstance(peak, int)
        assert isinstance(before, int)
        print(
            f"  {stage:8} {times[stage]:7.2f} s = {times[stage] / times['floor']:5.2f} x floor"
            f"   peak {peak / 1024:6.0f} MiB, of which {(peak - before) * 1024 / pixels:5.1f} bytes a pixel"
            " above the libraries"
        )
    total = times["load"] + times["walls"]
    print(
        f"  whole    {total:7.2f} s = {total / times['floor']:5.2f} x floor (load, then all of the reading)"
    )
    assert total > times["floor"]


def test_a_plan_of_65_megapixels(shared_data: Path) -> None:
    path = shared_data / "drawings" / "mls_302.png"
    truth = json.loads(path.with_suffix(".truth.json").read_text())
    report("mls_302", path, truth["metres_per_px"])


def test_a_generated_a0_sheet(a0_sheet: Path) -> None:
    report("A0 at 300 dpi, 1:50", a0_sheet, METRES_PER_PX)
