"""A person's corrections of a reading, in the file's own coordinates."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from service.domain.edits import edits_of
from worker.geometry.drawing.reading.edits import apply_edits
from worker.geometry.drawing.reading.file_frame import FileFrame, stroke_ids
from worker.geometry.drawing.reading.moved_lines import walls_of_lines
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall
from worker.geometry.drawing.scale.decision import Scale, given


def line(*points: tuple[float, float]) -> NDArray[np.float64]:
    return np.array(points, dtype=np.float64)


def a_reading(scale: float = 0.01) -> Reading:
    """Return a room of four walls, a pier, a letter and a bench, on 1300 x 1000 px."""
    corners = [(2.0, 2.0), (10.0, 2.0), (10.0, 8.0), (2.0, 8.0), (2.0, 2.0)]
    walls = tuple(Wall.of(line(a, b), thickness=0.2) for a, b in pairwise(corners))
    bench = RemovedStroke(
        (line((4.0, 4.0), (7.0, 4.0)), line((4.0, 4.15), (7.0, 4.15))), "furniture", "loose"
    )
    letter = RemovedStroke((line((5.0, 6.0), (5.1, 6.2)),), "text", "small")
    pier = Column(line((8.0, 5.0), (8.4, 5.0), (8.4, 5.4), (8.0, 5.4)))
    made = Reading(walls, (pier,), (bench, letter), (13.0, 10.0), given(0.01), "outlined", top=10.0)
    return replace(made.scaled(scale / 0.01), scale=given(scale))


def edited(reading: Reading, *edits: dict[str, Any]) -> Reading:
    return apply_edits(reading, edits_of(list(edits)))


def box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    """Return a rectangle [px, y down]."""
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def misfits(reading: Reading) -> list[int]:
    return [f.values["edit"] for f in reading.findings if f.code == "edit-does-not-fit"]


def total_length(reading: Reading) -> float:
    faces = sum(float(np.hypot(*np.diff(f, axis=0).T).sum()) for w in reading.walls for f in w.faces)
    strokes = sum(float(np.hypot(*np.diff(x, axis=0).T).sum()) for r in reading.removed for x in r.lines)
    return faces + strokes


@pytest.mark.parametrize("scale", [0.01, 0.02])
def test_names_rest_on_the_file_and_not_on_the_scale(scale: float) -> None:
    ids = stroke_ids(a_reading(scale))
    assert ids.removed == ("s400.0_585.0_700.0_600.0", "s500.0_380.0_510.0_400.0")
    assert ids.columns == ("c800.0_460.0_840.0_500.0",)
    assert len(set(ids.walls)) == 4


def test_strokes_of_one_box_have_names_of_their_own() -> None:
    reading = a_reading()
    cross = tuple(RemovedStroke((line(a, b),), "other", "") for a, b in (((1, 1), (2, 2)), ((1, 2), (2, 1))))
    ids = stroke_ids(replace(reading, removed=cross)).removed
    assert ids == ("s100.0_800.0_200.0_900.0", "s100.0_800.0_200.0_900.0~2")
    moved = edited(replace(reading, removed=cross), {"action": "move", "strokes": [ids[1]], "to": "text"})
    assert [r.layer for r in moved.removed] == ["other", "text"]
    assert moved.removed[1].lines == cross[1].lines


def test_parallel_lines_moved_to_the_walls_become_the_faces_of_one() -> None:
    reading = a_reading()
    name = stroke_ids(reading).removed[0]
    moved = edited(reading, {"action": "move", "strokes": [name], "to": "wall"})
    assert misfits(moved) == []
    (wall,) = moved.walls[4:]
    assert (wall.thickness, wall.kind, wall.reason) == (pytest.approx(0.15), "wall", "moved by a person")
    assert np.allclose(wall.centre, [[4.0, 4.075], [7.0, 4.075]])
    assert np.allclose(wall.faces[0][:, 1], 4.15)
    assert [r.layer for r in moved.removed] == ["text"]


def test_a_single_line_moved_to_the_walls_becomes_a_partition() -> None:
    moved = edited(a_reading(), {"action": "move", "within": box(490, 370, 520, 410), "to": "wall"})
    (partition,) = moved.walls[4:]
    assert partition.kind == "partition"
    assert np.allclose(partition.centre, [[5.0, 6.0], [5.1, 6.2]])


def test_only_the_named_layers_leave_a_polygon() -> None:
    everything = box(0, 0, 1300, 1000)
    moved = edited(a_reading(), {"action": "move", "within": everything, "of": ["text"], "to": "symbol"})
    assert sorted(r.layer for r in moved.removed) == ["furniture", "symbol"]
    assert len(moved.walls) == 4


def test_walls_moved_away_are_set_aside_with_the_reason() -> None:
    reading = a_reading()
    moved = edited(reading, {"action": "move", "strokes": [stroke_ids(reading).walls[0]], "to": "furniture"})
    assert len(moved.walls) == 3
    assert (moved.removed[-1].layer, moved.removed[-1].reason) == ("furniture", "moved by a person")
    assert all(
        np.allclose(a, b) for a, b in zip(moved.removed[-1].lines, reading.walls[0].faces, strict=True)
    )


def test_a_polygon_cuts_walls_exactly_and_nothing_is_lost() -> None:
    reading = a_reading()
    cut = edited(reading, {"action": "erase-walls", "within": box(500, 700, 600, 900)})
    low = [w for w in cut.walls if np.allclose(w.centre[:, 1], 2.0)]
    assert sorted(w.centre[:, 0].tolist() for w in low) == [[2.0, 5.0], [6.0, 10.0]]
    for wall in low:
        assert all(np.allclose(face[:, 0], wall.centre[:, 0]) for face in wall.faces)
    assert {r.reason for r in cut.removed[2:]} == {"erased by a person"}
    assert total_length(cut) == pytest.approx(total_length(reading))


def test_a_slanted_cut_cuts_each_face_where_it_meets_it() -> None:
    slanted = [[500, 900], [520, 700], [620, 700], [600, 900]]
    cut = edited(a_reading(), {"action": "erase-walls", "within": slanted})
    left = next(w for w in cut.walls if np.allclose(w.centre[0], [2.0, 2.0]) and w.centre[1, 1] == 2.0)
    ends = [float(face[:, 0].max()) for face in left.faces]
    assert ends == pytest.approx([5.0 + 0.1 * (9.0 - 7.9), 5.0 + 0.1 * (9.0 - 8.1)])


def test_regions_leave_only_what_they_include() -> None:
    reading = a_reading()
    kept = edited(
        reading,
        {"action": "include", "within": box(100, 100, 400, 900)},
        {"action": "include", "within": box(900, 100, 1100, 900)},
    )
    body = shapely.union_all([shapely.LineString(w.centre) for w in kept.walls])
    assert body.length == pytest.approx(2 * 6.0 + 2 * 2.0 + 2 * 1.0)
    assert kept.columns == ()
    assert misfits(kept) == []
    out = edited(reading, {"action": "exclude", "within": box(100, 100, 400, 900)})
    assert sum(w.length for w in out.walls) == pytest.approx(28.0 - 6.0 - 4.0)
    assert {r.reason for r in out.removed[2:]} == {"in a region that a person excluded"}


def test_added_walls_have_the_thickness_that_was_said_or_the_others() -> None:
    one = {"action": "add-wall", "line": [[400, 200], [400, 800]]}
    made = edited(a_reading(), one, {**one, "thickness_m": 0.35})
    assert [w.thickness for w in made.walls[4:]] == pytest.approx([0.2, 0.35])
    assert np.allclose(made.walls[4].centre, [[4.0, 8.0], [4.0, 2.0]])


def test_edits_lie_on_the_sheet_whatever_the_scale() -> None:
    edits = [
        {"action": "erase-walls", "within": box(500, 700, 600, 900)},
        {"action": "move", "strokes": [stroke_ids(a_reading()).removed[1]], "to": "symbol"},
    ]
    one, two = (edited(a_reading(scale), *edits) for scale in (0.01, 0.03))
    assert misfits(two) == []
    assert len(one.walls) == len(two.walls)
    for a, b in zip(one.walls, two.walls, strict=True):
        assert np.allclose(3.0 * a.centre, b.centre)


def test_without_a_scale_edits_work_on_pixels() -> None:
    reading = replace(a_reading().scaled(100.0), scale=Scale("unknown", None))
    made = edited(reading, {"action": "add-wall", "line": [[400, 200], [400, 800]], "thickness_m": 0.3})
    assert made.walls[4].thickness == pytest.approx(20.0)
    assert np.allclose(made.walls[4].centre, [[400, 800], [400, 200]])


def test_in_drawing_units_y_runs_up_and_the_origin_is_taken_off() -> None:
    reading = replace(a_reading(), top=None, origin=(1000.0, 500.0), scale=given(0.001))
    frame = FileFrame.of(reading)
    assert np.allclose(frame.to_drawing([(1_004_000.0, 502_000.0)]), [[4.0, 2.0]])
    assert np.allclose(frame.to_file(np.array([[4.0, 2.0]])), [[1_004_000.0, 502_000.0]])
    made = edited(reading, {"action": "add-wall", "line": [[1_004_000, 502_000], [1_004_000, 508_000]]})
    assert np.allclose(made.walls[4].centre, [[4.0, 2.0], [4.0, 8.0]])


def test_what_no_longer_fits_is_named_and_the_rest_applied() -> None:
    reading = a_reading()
    lost = ["s1.0_1.0_2.0_2.0"]
    made = edited(
        reading,
        {"action": "move", "strokes": lost, "to": "wall"},
        {"action": "exclude", "within": box(400, 350, 700, 420)},
        {"action": "add-wall", "line": [[5000, 5000], [6000, 5000]]},
        {"action": "include", "within": box(0, 0, 50, 50)},
        {"action": "erase-walls", "within": box(500, 700, 600, 900)},
    )
    assert misfits(made) == [0, 1, 2, 3]
    assert len(made.walls) == 5
    assert made.counts["edits_applied"] == 1


def test_a_stroke_a_little_elsewhere_is_still_meant() -> None:
    reading = a_reading()
    name = stroke_ids(reading).removed[0]
    moved = replace(
        reading,
        removed=tuple(replace(r, lines=tuple(x + 0.015 for x in r.lines)) for r in reading.removed),
    )
    fitted = edited(moved, {"action": "move", "strokes": [name], "to": "hatch"})
    assert misfits(fitted) == []
    assert [r.layer for r in fitted.removed] == ["text", "hatch"]


def test_a_stroke_that_is_where_it_should_be_fits() -> None:
    reading = a_reading()
    again = edited(reading, {"action": "move", "strokes": [stroke_ids(reading).walls[1]], "to": "wall"})
    assert (misfits(again), len(again.walls), len(again.removed)) == ([], 4, 2)


def test_a_rectangle_becomes_one_wall_without_its_ends() -> None:
    rectangle = line((0, 0), (3, 0), (3, 0.2), (0, 0.2), (0, 0))
    (wall,) = walls_of_lines([rectangle], metres_per_unit=1.0, reason="drawn")
    assert wall.thickness == pytest.approx(0.2)
    assert wall.length == pytest.approx(3.0)


def test_progress_is_told_and_may_end_the_work() -> None:
    def stop(_stage: str, _share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        apply_edits(a_reading(), edits_of([{"action": "exclude", "within": box(0, 0, 9, 9)}]), progress=stop)
