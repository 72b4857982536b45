from __future__ import annotations

import numpy as np
import pytest

from service.domain.errors import DrawingTooComplex
from worker.geometry.drawing.linework.pairs import pair_lines


def turned(ends: list[list[list[float]]], angle: float) -> np.ndarray:
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.array(ends, dtype=np.float64) @ rotation


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2, np.pi / 2, 2.5])
def test_two_lines_are_the_faces_of_one_wall_whatever_its_direction(angle: float) -> None:
    (wall,) = pair_lines(turned([[[0, 0], [5, 0]], [[5, 0.2], [0, 0.2]]], angle))
    assert wall.thickness == pytest.approx(0.2)
    assert wall.length == pytest.approx(5.0)
    step = wall.centre[1] - wall.centre[0]
    to_left = wall.faces[0][0] - wall.centre[0]
    assert step[0] * to_left[1] - step[1] * to_left[0] > 0


def test_a_wall_broken_at_a_door_is_two_walls_closed_by_their_jambs() -> None:
    lines = [[[0, y], [2, y]] for y in (0, 0.2)] + [[[3, y], [6, y]] for y in (0, 0.2)]
    jambs = [[[2, 0], [2, 0.2]], [[3, 0], [3, 0.2]]]
    walls = pair_lines(turned(lines + jambs, 0.0))
    assert sorted(round(w.length, 6) for w in walls) == [2.0, 3.0]
    assert {w.kind for w in walls} == {"wall"}
    drawn = sum(float(np.hypot(*np.diff(f, axis=0).T).sum()) for w in walls for f in w.faces)
    assert drawn == pytest.approx(2 * 2 + 2 * 3 + 2 * 0.2)


def test_a_line_without_counterpart_is_a_partition_of_no_thickness() -> None:
    (wall,) = pair_lines(np.array([[[0.0, 0.0], [4.0, 0.0]]]))
    assert (wall.kind, wall.thickness) == ("partition", 0.0)
    assert np.array_equal(wall.faces[0], wall.faces[1])


def test_of_several_lines_the_nearest_pair_and_a_shaft_between_two_walls_is_none() -> None:
    walls = pair_lines(np.array([[[0.0, y], [5.0, y]] for y in (0.0, 0.1, 0.55, 0.65)]))
    assert sorted(round(w.thickness, 6) for w in walls) == [0.1, 0.1]


def test_repeated_lines_count_once() -> None:
    one = [[[0.0, 0.0], [5.0, 0.0]], [[0.0, 0.2], [5.0, 0.2]]]
    assert len(pair_lines(np.array(one * 3))) == 1


def test_lines_without_number_are_refused_before_they_are_compared() -> None:
    ends = np.random.default_rng(1).uniform(0.0, 0.6, (12_000, 2, 2))
    with pytest.raises(DrawingTooComplex):
        pair_lines(ends)
