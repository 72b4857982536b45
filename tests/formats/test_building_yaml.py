"""Open-RMF building files: walls in metres by the measurements, and files that are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from service.domain.bounds import Bounds
from service.domain.errors import (
    DrawingTooComplex,
    FileEmpty,
    FileMalformed,
    NotFinite,
    NoWallsFound,
    PageNeeded,
    PageNotFound,
    UnsupportedMedia,
)
from service.domain.scale_hint import KnownLength, ScaleHint
from worker.formats.building_yaml import WALL_THICKNESS, load_building_yaml

METRES_A_PIXEL = 0.02


def _level(scale: float = METRES_A_PIXEL, *, measured: tuple[float, ...] = (1.0, 1.0)) -> dict[str, Any]:
    """Return a room of 10 x 6 m with a door of 0.9 m in its lower side, in pixels, y down."""
    corners = [(0, 0), (4, 0), (4.9, 0), (10, 0), (10, 6), (0, 6)]
    vertices = [[100 + x / scale, 900 - y / scale, 0.0, "", {}] for x, y in corners]
    runs = [(0, 3, 10.0), (3, 4, 6.0)]
    return {
        "drawing": {"filename": "floor.png"},
        "elevation": 0,
        "vertices": vertices,
        "walls": [
            [a, b, {"texture_name": [1, "default"]}] for a, b in ((0, 1), (2, 3), (3, 4), (4, 5), (5, 0))
        ],
        "doors": [[1, 2, {"name": [1, "d"], "type": [1, "hinged"]}]],
        "measurements": [
            [a, b, {"distance": [3, length * factor]}]
            for (a, b, length), factor in zip(runs, measured, strict=False)
        ],
        "lanes": [[0, 4, {"bidirectional": [4, True]}]],
        "floors": [{"parameters": {}, "vertices": [0, 3, 4, 5]}],
        "models": [{"name": "Chair", "model_name": "Chair", "x": 300.0, "y": 800.0, "yaw": 0.1}],
    }


def _write(path: Path, level: dict[str, Any], **more: Any) -> Path:
    path.write_text(yaml.safe_dump({"name": "b", "levels": {"L1": level}, **more}))
    return path


def test_a_room_is_read_in_metres_with_y_up(tmp_path: Path) -> None:
    reading = load_building_yaml(_write(tmp_path / "b.building.yaml", _level()))
    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == pytest.approx(METRES_A_PIXEL)
    assert len(reading.walls) == 1  # it runs on around the room, from the door to the door
    wall = reading.walls[0]
    assert wall.thickness == WALL_THICKNESS
    at = wall.centre + reading.origin - (100 * METRES_A_PIXEL, -900 * METRES_A_PIXEL)
    expected = [(4, 0), (0, 0), (0, 6), (10, 6), (10, 0), (4.9, 0)]
    assert np.allclose(at if at[0, 0] < 4.5 else at[::-1], expected, atol=1e-9)
    layers = sorted(r.layer for r in reading.removed)
    assert layers == ["dimension", "dimension", "door", "furniture", "other", "other"]


def test_measurements_are_fitted_by_least_squares(tmp_path: Path) -> None:
    path = _write(tmp_path / "b.yaml", _level(measured=(1.002, 0.996)))
    reading = load_building_yaml(path)
    drawn, said = np.array([10.0, 6.0]), np.array([10.02, 5.976])
    fitted = METRES_A_PIXEL * float(drawn @ said / (drawn @ drawn))
    assert reading.scale.metres_per_unit == pytest.approx(fitted, rel=1e-9)
    compared = next(f for f in reading.findings if f.code == "measurements-compared")
    assert compared.severity == "info"


def test_measurements_that_disagree_leave_the_scale_unknown(tmp_path: Path) -> None:
    path = _write(tmp_path / "b.yaml", _level(measured=(1.0, 1.3)))
    reading = load_building_yaml(path)
    assert reading.scale.state == "unknown"
    assert {round(c, 4) for c in reading.scale.candidates} >= {0.02, 0.026}
    assert reading.unit == "px"
    told = load_building_yaml(path, hint=ScaleHint(metres_per_unit=METRES_A_PIXEL))
    assert told.scale.state == "given"
    assert sum(w.length for w in told.walls) == pytest.approx(31.1)


@pytest.mark.parametrize("doors", [True, False])
@pytest.mark.parametrize("factor", [1.0, 0.37, 12.0, 1000.0])
def test_one_measurement_decides_also_against_doors(tmp_path: Path, factor: float, *, doors: bool) -> None:
    level = _level(measured=(factor,))
    if not doors:
        level["doors"] = []
    reading = load_building_yaml(_write(tmp_path / "b.yaml", level))
    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == pytest.approx(METRES_A_PIXEL * factor, rel=1e-12)
    assert reading.unit == "m"
    said = {f.code for f in reading.findings}
    assert ("scale-contradicted" in said) == (doors and not 0.55 <= 0.9 * factor <= 4.0)
    assert "scale-unknown" not in said


def test_the_same_length_given_beside_the_file_is_the_same_reading(tmp_path: Path) -> None:
    inside = load_building_yaml(_write(tmp_path / "a.yaml", _level(measured=(1.0,))))
    bare = _write(tmp_path / "b.yaml", _level(measured=()))
    hint = ScaleHint(known_length=KnownLength(0.0, 0.0, 10.0 / METRES_A_PIXEL, 0.0, 10.0))
    outside = load_building_yaml(bare, hint=hint)
    assert outside.scale.state == "given"
    assert outside.scale.metres_per_unit == pytest.approx(inside.scale.metres_per_unit, rel=1e-12)
    for one, other in zip(outside.walls, inside.walls, strict=True):
        assert np.allclose(one.centre, other.centre, atol=1e-9)


@pytest.mark.parametrize(
    ("measured", "value"),
    [
        ((1.0, 1.0, 1.0), 1.0),
        ((1.0, 1.0, 3.0), 1.0),
        ((3.0, 1.0, 1.0), 1.0),
        ((1.0, 3.0), None),
        ((1.0, 1.0, 3.0, 3.0), None),
        ((1.0, 2.0, 3.0), None),
        ((1.0, 10.0), 1.0),  # of the two, doors of 0.9 m speak for one, doors of 9 m for none
    ],
)
def test_of_several_measurements_most_decide(
    tmp_path: Path, measured: tuple[float, ...], value: float | None
) -> None:
    level = _level(measured=())
    level["measurements"] = [
        [a, b, {"distance": [3, length * factor]}]
        for (a, b, length), factor in zip(
            [(0, 3, 10.0), (3, 4, 6.0), (4, 5, 10.0), (5, 0, 6.0)], measured, strict=False
        )
    ]
    reading = load_building_yaml(_write(tmp_path / "b.yaml", level))
    if value is None:
        assert (reading.scale.state, reading.unit) == ("unknown", "px")
        assert {round(c / METRES_A_PIXEL, 6) for c in reading.scale.candidates} == set(measured)
        return
    assert reading.scale.metres_per_unit == pytest.approx(value * METRES_A_PIXEL)
    compared = next(f for f in reading.findings if f.code == "measurements-compared")
    assert (compared.severity == "warning") == (len(set(measured)) > 1)


def test_each_level_has_the_scale_of_its_own_measurement(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    levels = {f"L{k}": _level(0.01 * k, measured=(1.0,) if k < 4 else ()) for k in (1, 2, 3, 4)}
    levels["L4"]["doors"] = []
    path.write_text(yaml.safe_dump({"levels": levels}, sort_keys=False))
    scales = [load_building_yaml(path, page=k).scale for k in (1, 2, 3, 4)]
    assert [s.metres_per_unit for s in scales[:3]] == pytest.approx([0.01, 0.02, 0.03])
    assert (scales[3].state, scales[3].candidates) == ("unknown", ())


@pytest.mark.parametrize(
    "empty", [[0, 3, {"distance": [3, 0.0]}], [0, 3, {"distance": -2}], [0, 0, {"distance": 5}]]
)
def test_a_measurement_of_nothing_is_left_out_and_told(tmp_path: Path, empty: list[Any]) -> None:
    level = _level(measured=(1.0,))
    level["measurements"].insert(0, empty)
    reading = load_building_yaml(_write(tmp_path / "b.yaml", level))
    assert reading.scale.metres_per_unit == pytest.approx(METRES_A_PIXEL)
    told = {f.code: f for f in reading.findings}
    assert told["measurements-empty"].values == {"count": 1}
    assert told["measurements-compared"].values["deviation_shares"] == [0.0]
    level["measurements"] = [empty]
    alone = load_building_yaml(_write(tmp_path / "c.yaml", level))
    assert (alone.scale.state, alone.scale.candidates) == ("unknown", ())


def test_metres_are_metres_and_degrees_are_projected(tmp_path: Path) -> None:
    level = _level()
    plane = [(0.0, 0.0), (4.0, 0.0), (4.9, 0.0), (10.0, 0.0), (10.0, 6.0), (0.0, 6.0)]
    level |= {"vertices": [[x, y, 0.0, ""] for x, y in plane], "measurements": [], "models": []}
    metres = load_building_yaml(_write(tmp_path / "m.yaml", level, coordinate_system="cartesian_meters"))
    assert metres.scale.state == "found"
    assert metres.scale.metres_per_unit == 1.0
    assert max(w.centre[:, 1].max() for w in metres.walls) + metres.origin[1] == pytest.approx(6.0)
    east, north = 74_625.2, 111_200.2  # metres a degree at 48 degrees north (WGS 84)
    level["vertices"] = [[9.0 + x / east, 48.0 + y / north, 0.0, ""] for x, y in plane]
    globe = load_building_yaml(_write(tmp_path / "g.yaml", level, coordinate_system="wgs84"))
    assert sum(w.length for w in globe.walls) == pytest.approx(31.1, rel=1e-3)


def test_a_level_is_chosen_by_number_or_name(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    other = _level() | {"walls": [[0, 1, {}]]}
    path.write_text(yaml.safe_dump({"levels": {"L1": _level(), "L2": other}}, sort_keys=False))
    with pytest.raises(PageNeeded) as refusal:
        load_building_yaml(path)
    assert [(p["page"], p["name"], p["walls"]) for p in refusal.value.members["pages"]] == [
        (1, "L1", 5),
        (2, "L2", 1),
    ]
    assert len(load_building_yaml(path, page=2).walls[0].centre) == 2
    assert len(load_building_yaml(path, storey="l2").walls[0].centre) == 2
    with pytest.raises(PageNotFound):
        load_building_yaml(path, page=3)
    with pytest.raises(PageNotFound):
        load_building_yaml(path, storey="cellar")


def test_a_level_without_walls_is_told(tmp_path: Path) -> None:
    with pytest.raises(NoWallsFound):
        load_building_yaml(_write(tmp_path / "b.yaml", _level() | {"walls": []}))


def test_aliases_are_refused_before_they_unfold(tmp_path: Path) -> None:
    path = tmp_path / "b.yaml"
    bomb = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    bomb += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    path.write_text("\n".join([*bomb, "levels: *a11", ""]))
    with pytest.raises(FileMalformed, match="anchor or alias"):
        load_building_yaml(path)


@pytest.mark.parametrize(
    ("text", "leaf"),
    [
        ("", FileEmpty),
        ("levels: [", FileMalformed),
        ("levels: !!python/object/apply:os.system ['true']", FileMalformed),
        ("- 1\n- 2\n", FileMalformed),
        ("levels: 3\n", FileMalformed),
        ("levels: {L1: 7}\n", FileMalformed),
        ("levels: {L1: {vertices: 4}}\n", FileMalformed),
        ("levels: {L1: {vertices: [[1]], walls: []}}\n", FileMalformed),
        ("levels: {L1: {vertices: [[1, .nan, 0]], walls: []}}\n", NotFinite),
        ("levels: {L1: {vertices: [[1, .inf, 0]], walls: []}}\n", NotFinite),
        ("levels: {L1: {vertices: [[1, 1e300, 0]], walls: []}}\n", FileMalformed),
        ("levels: {L1: {vertices: [[1, 2, 0]], walls: [[0, 1]]}}\n", FileMalformed),
        ("levels: {L1: {vertices: [[1, 2, 0]], walls: [[0, -1]]}}\n", FileMalformed),
        ("levels: {L1: {vertices: [[0, 0], [1, 0]], measurements: [[0, 1, {}]]}}\n", FileMalformed),
        ("coordinate_system: web_mercator\nlevels: {L1: {}}\n", UnsupportedMedia),
        ("levels: " + "[" * 100 + "]" * 100, DrawingTooComplex),
        ("levels: {L1: {elevation: " + "1:" * 9000 + "1}}", FileMalformed),
        ("levels: {L1: {elevation: " + "9" * 8000 + "}}", FileMalformed),
        ("levels: {L1: \x00}", FileMalformed),
    ],
)  # fmt: skip
def test_each_bad_file_has_its_own_problem(text: str, leaf: type[Exception], tmp_path: Path) -> None:
    path = tmp_path / "b.building.yaml"
    path.write_text(text)
    with pytest.raises(leaf):
        load_building_yaml(path)


def test_sizes_are_bounded(tmp_path: Path) -> None:
    path = _write(tmp_path / "b.yaml", _level())
    with pytest.raises(DrawingTooComplex):
        load_building_yaml(path, bounds=Bounds(max_yaml_bytes=100))
    with pytest.raises(DrawingTooComplex):
        load_building_yaml(path, bounds=Bounds(max_yaml_nodes=50))


def test_the_collected_building_has_the_scale_that_its_writer_typed(shared_cases: Path) -> None:
    reading = load_building_yaml(shared_cases / "45-rmf-one-measurement" / "plain.building.yaml")
    assert (reading.scale.state, reading.unit) == ("found", "m")
    assert reading.scale.metres_per_unit == pytest.approx(0.02)
    ends = np.vstack([wall.centre for wall in reading.walls])
    assert np.ptp(ends, axis=0) == pytest.approx([19.7, 11.7], abs=0.01)
