"""IFC models: a storey's walls by a cut, and models that are refused."""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from service.domain.errors import (
    DrawingTooComplex,
    FileMalformed,
    FileTruncated,
    NoWallsFound,
    PageNeeded,
    PageNotFound,
    UnsupportedMedia,
)
from service.domain.scale_hint import ScaleHint
from tests.formats.ifc_models import ModelWriter, Solid, bar, house_solids, small_house
from worker.formats.drawing import read_drawing_file
from worker.formats.ifc import load_ifc
from worker.geometry.drawing.reading.reading import Reading


class Cancelled(Exception):
    """A person has cancelled."""


def _faces(reading: Reading) -> set[tuple[float, ...]]:
    """Return the walls' faces in model coordinates, each as its two ends in order [m]."""
    ends = [np.vstack([f[0], f[-1]]) + reading.origin for w in reading.walls for f in w.faces]
    return {tuple(np.round(e[np.lexsort(e.T[::-1])].ravel(), 3).tolist()) for e in ends}


def _covered(reading: Reading, line: NDArray[np.float64]) -> float:
    """Return which share of a line lies within 1 mm of a face."""
    points = line[0] + (line[1] - line[0]) * np.linspace(0.001, 0.999, 200)[:, None]
    near = np.zeros(len(points), dtype=bool)
    for wall in reading.walls:
        for face in wall.faces:
            for a, b in zip(face[:-1] + reading.origin, face[1:] + reading.origin, strict=True):
                t = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-12), 0.0, 1.0)
                near |= np.hypot(*(points - a - t[:, None] * (b - a)).T) < 1e-3
    return float(near.mean())


@pytest.mark.parametrize("unit", ["mm", "cm", "m", "ft"])
def test_a_house_has_its_walls_in_metres_whatever_its_unit(unit: str, tmp_path: Path) -> None:
    reading = load_ifc(small_house(unit).write(tmp_path / "house.ifc"))

    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == pytest.approx(
        {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "ft": 0.3048}[unit]
    )
    assert sorted({round(w.thickness, 4) for w in reading.walls}) == [0.1, 0.3]
    outer = np.array([[0, 0], [10, 0], [10, 6], [0, 6], [0, 0]], dtype=np.float64)
    inner = np.array([[0.3, 0.3], [5, 0.3], [5, 2]], dtype=np.float64)
    for a, b in [*pairwise(outer[1:]), *pairwise(inner)]:
        assert _covered(reading, np.stack([a, b])) == 1.0
    assert _covered(reading, np.array([[0.0, 0.0], [10.0, 0.0]])) == pytest.approx(0.85, abs=0.01)  # a window
    assert _covered(reading, np.array([[5.0, 2.0], [5.0, 2.9]])) < 0.02  # a door
    assert [np.ptp(c.outline, axis=0).tolist() for c in reading.columns] == [pytest.approx([0.4, 0.4])]
    assert sorted(r.layer for r in reading.removed) == ["door", "furniture", "stair", "window"]
    assert all(r.reason for r in reading.removed)


def test_a_cut_below_the_sill_closes_the_window(tmp_path: Path) -> None:
    path = small_house().write(tmp_path / "house.ifc")
    reading = load_ifc(path, cut_height_m=0.5)
    assert _covered(reading, np.array([[0.0, 0.0], [10.0, 0.0]])) == 1.0


def test_a_door_without_an_opening_is_cut_out(tmp_path: Path) -> None:
    model = ModelWriter()
    wall = Solid("IfcWall", bar(0, 0, 6, 0.2))
    model.storey("Ground", 0.0, [wall, Solid("IfcDoor", bar(2, 0.05, 2.9, 0.15), high=2.1)])
    reading = load_ifc(model.write(tmp_path / "m.ifc"))
    assert len(reading.walls) == 2
    assert _covered(reading, np.array([[2.0, 0.0], [2.9, 0.0]])) < 0.02
    assert _covered(reading, np.array([[0.0, 0.0], [1.97, 0.0]])) == 1.0
    assert "doors-cut-out" in {f.code for f in reading.findings}


def test_a_curved_wall_is_one_wall_of_one_thickness(tmp_path: Path) -> None:
    angle = np.linspace(0.0, np.pi / 2, 19)
    ring = [(5 * np.cos(a), 5 * np.sin(a)) for a in angle] + [
        (4.8 * np.cos(a), 4.8 * np.sin(a)) for a in angle[::-1]
    ]
    model = ModelWriter()
    model.storey("Ground", 0.0, [Solid("IfcWall", [(float(x), float(y)) for x, y in ring])])
    reading = load_ifc(model.write(tmp_path / "m.ifc"))
    assert len(reading.walls) == 1
    wall = reading.walls[0]
    assert wall.thickness == pytest.approx(0.2, abs=0.002)
    assert wall.length == pytest.approx(4.9 * np.pi / 2, rel=0.002)
    radius = np.hypot(*(wall.centre + reading.origin).T)
    assert np.abs(radius - 4.9).max() < 0.01


def test_several_storeys_are_asked_for_and_listed(tmp_path: Path) -> None:
    model = ModelWriter()
    model.storey("First", 3.0, [Solid("IfcWall", bar(0, 0, 4, 0.2))])
    model.storey("Ground", 0.0, house_solids())
    path = model.write(tmp_path / "two.ifc")

    with pytest.raises(PageNeeded) as refusal:
        load_ifc(path)
    assert [(p["page"], p["name"], p["walls"]) for p in refusal.value.members["pages"]] == [
        (1, "Ground", 5),
        (2, "First", 1),
    ]
    above = load_ifc(path, storey="first")
    assert len(above.walls) == 1
    assert above.walls[0].length == pytest.approx(4.0)
    assert _faces(load_ifc(path, page=1)) == _faces(load_ifc(path, storey="Ground"))
    with pytest.raises(PageNotFound):
        load_ifc(path, storey="Attic")
    with pytest.raises(PageNotFound):
        load_ifc(path, page=3)


def test_the_storey_is_an_option_of_any_reading(tmp_path: Path) -> None:
    model = ModelWriter("m")
    model.storey("Ground", 0.0, [Solid("IfcWall", bar(0, 0, 4, 0.2))])
    model.storey("First", 3.0, [Solid("IfcWall", bar(0, 0, 7, 0.2), openings=[(bar(2, -1, 3, 1), 0.9, 2.0)])])
    path = model.write(tmp_path / "upload")
    reading = read_drawing_file(path, options=DrawingOptions(storey="First"))
    assert sorted(w.length for w in reading.walls) == [pytest.approx(2.0), pytest.approx(4.0)]
    below = read_drawing_file(path, options=DrawingOptions(page=2, cut_height_m=0.5))
    assert [w.length for w in below.walls] == [pytest.approx(7.0)]


def test_the_sample_models(shared_data: Path) -> None:
    house = load_ifc(shared_data / "drawings" / "Ifc4_SampleHouse.ifc")
    assert (house.scale.state, house.scale.metres_per_unit) == ("found", 0.001)
    assert {round(w.thickness, 3) for w in house.walls} == {0.0, 0.065, 0.095, 0.29}
    assert sum(w.length for w in house.walls) == pytest.approx(38.5, abs=1.0)
    layers = [r.layer for r in house.removed]
    assert (layers.count("door"), layers.count("window"), layers.count("furniture")) == (3, 4, 14)
    walls = load_ifc(shared_data / "drawings" / "project0-walls.ifc")
    assert sorted(round(w.thickness, 3) for w in walls.walls) == [0.1] + [0.2] * 6


def test_a_storey_that_is_not_placed_is_found_by_its_walls(tmp_path: Path) -> None:
    model = ModelWriter(placed=False)
    model.storey("Ground", 0.0, [Solid("IfcWall", bar(0, 0, 4, 0.2))])
    model.storey("First", 3.0, [Solid("IfcWall", bar(0, 0, 7, 0.2))])
    reading = load_ifc(model.write(tmp_path / "m.ifc"), storey="First")
    assert [w.length for w in reading.walls] == [pytest.approx(7.0)]


def test_walls_that_the_cut_passes_by_are_set_aside(tmp_path: Path) -> None:
    model = ModelWriter()
    low = Solid("IfcWall", bar(0, 2, 4, 2.2), high=0.9)
    model.storey("Ground", 0.0, [Solid("IfcWall", bar(0, 0, 4, 0.2)), low])
    path = model.write(tmp_path / "m.ifc")
    reading = load_ifc(path)
    assert len(reading.walls) == 1
    assert [(r.layer, "0.00 to 0.90" in r.reason) for r in reading.removed] == [("other", True)]
    with pytest.raises(NoWallsFound, match=r"from 0\.00 to 2\.80"):
        load_ifc(path, cut_height_m=5.0)


def test_a_unit_that_doors_and_walls_contradict_is_put_right(tmp_path: Path) -> None:
    model = small_house("m")
    model.file.by_type("IfcSIUnit")[0].Prefix = "MILLI"
    path = model.write(tmp_path / "m.ifc")
    reading = load_ifc(path)
    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == 1.0
    assert max(w.thickness for w in reading.walls) == pytest.approx(0.3)
    assert "scale-contradicted" in {f.code for f in reading.findings}
    told = load_ifc(path, hint=ScaleHint(metres_per_unit=0.5))
    assert told.scale.state == "given"
    assert max(w.thickness for w in told.walls) == pytest.approx(0.15)


def test_units_that_nothing_agrees_on_are_unknown(tmp_path: Path) -> None:
    model = ModelWriter("m")
    model.storey("Ground", 0.0, [Solid("IfcWall", bar(0, 0, 40, 0.2), high=100.0)])
    model.file.by_type("IfcSIUnit")[0].Prefix = "MILLI"
    reading = load_ifc(model.write(tmp_path / "m.ifc"))
    assert reading.scale.state == "unknown"
    assert reading.unit == "px"
    assert reading.walls[0].thickness == pytest.approx(0.2)  # in the file's own units
    assert "scale-unknown" in {f.code for f in reading.findings}


def test_coordinates_far_away_lose_nothing(tmp_path: Path) -> None:
    model = ModelWriter("m")
    model.storey("Ground", 0.0, [Solid("IfcWall", bar(512_000, 5_400_000, 512_006, 5_400_000.2))])
    reading = load_ifc(model.write(tmp_path / "m.ifc"))
    assert reading.walls[0].thickness == pytest.approx(0.2, abs=1e-3)
    assert reading.walls[0].centre.max() < 10.0
    assert reading.origin == pytest.approx((511_999.5, 5_399_999.5), abs=0.02)


def test_a_cut_off_model_is_refused(tmp_path: Path) -> None:
    path = small_house().write(tmp_path / "m.ifc")
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(FileTruncated, match="END-ISO-10303-21"):
        load_ifc(path)


def test_garbage_between_head_and_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.ifc"
    rng = np.random.default_rng(1)
    path.write_bytes(b"ISO-10303-21;\nHEADER;" + rng.bytes(50_000) + b"\nEND-ISO-10303-21;\n")
    with pytest.raises((FileMalformed, NoWallsFound)):
        load_ifc(path)


def test_references_to_nothing_are_refused(tmp_path: Path) -> None:
    path = small_house().write(tmp_path / "m.ifc")
    text = path.read_text()
    start = text.index("DATA;")
    lines = [line for line in text[start:].splitlines() if "IFCCARTESIANPOINT" not in line]
    path.write_text(text[:start] + "\n".join(lines) + "\n")
    with pytest.raises((FileMalformed, NoWallsFound)):
        load_ifc(path)


def test_an_absurd_coordinate_takes_only_its_own_wall(tmp_path: Path) -> None:
    model = small_house("m")
    point = next(p for p in model.file.by_type("IfcCartesianPoint") if p.Coordinates == (0.0, 6.0))
    point.Coordinates = (1e308, 6.0)
    reading = load_ifc(model.write(tmp_path / "m.ifc"))
    assert len(reading.walls) >= 6
    assert all(np.isfinite(w.centre).all() and np.abs(w.centre).max() < 100.0 for w in reading.walls)
    assert _covered(reading, np.array([[10.0, 0.0], [10.0, 5.7]])) == 1.0


def test_a_model_without_walls_says_what_it_holds(tmp_path: Path) -> None:
    model = ModelWriter()
    model.storey("Ground", 0.0, [Solid("IfcBuildingElementProxy", bar(0, 0, 4, 0.2))])
    with pytest.raises(NoWallsFound, match="IfcBuildingElementProxy"):
        load_ifc(model.write(tmp_path / "m.ifc"))


def test_another_step_schema_is_no_ifc(tmp_path: Path) -> None:
    path = tmp_path / "part.stp"
    path.write_text(
        "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n"
    )
    with pytest.raises(UnsupportedMedia, match="another schema"):
        load_ifc(path)


def test_limits_of_size_and_time_are_kept(tmp_path: Path) -> None:
    path = small_house().write(tmp_path / "m.ifc")
    with pytest.raises(DrawingTooComplex, match="MiB"):
        load_ifc(path, bounds=Bounds(max_model_bytes=1000))
    with pytest.raises(DrawingTooComplex, match="takes longer"):
        load_ifc(path, bounds=Bounds(max_model_seconds=0.05))
    with pytest.raises((DrawingTooComplex, FileMalformed)):
        load_ifc(path, bounds=Bounds(max_model_memory_bytes=24 << 20))


def test_cancelling_ends_the_kernel(tmp_path: Path) -> None:
    path = small_house().write(tmp_path / "m.ifc")
    told: list[tuple[str, float]] = []

    def cancel(stage: str, share: float) -> None:
        told.append((stage, share))
        if len(told) == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        load_ifc(path, progress=cancel)
    assert len(told) == 2


def test_without_the_extra_it_is_said_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = small_house().write(tmp_path / "m.ifc")
    monkeypatch.setitem(sys.modules, "ifcopenshell", None)
    with pytest.raises(UnsupportedMedia, match=r"groundplan\[worker,ifc\]"):
        load_ifc(path)
