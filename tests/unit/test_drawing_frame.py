"""Where a drawing's frame lies in its file: told by a reading, or unknown."""

from __future__ import annotations

from typing import Any

import pytest

from service.domain.drawing_frame import DrawingFrame


@pytest.mark.parametrize(
    ("reading", "frame"),
    [
        ({"drawing_origin": [3.0, 4], "drawing_top": None}, DrawingFrame((3.0, 4.0))),
        ({"unit": "m", "drawing_origin": [0.0, 0.0], "drawing_top": 8.0}, DrawingFrame((0.0, 0.0), 8.0)),
        ({"unit": "unit", "drawing_origin": [0.0, 0.0], "drawing_top": 8.0}, None),
        ({"drawing_origin": [0.0, 0.0]}, None),
        ({"drawing_origin": None, "drawing_top": 8.0}, None),
        ({"drawing_origin": [None, None], "drawing_top": None}, None),
        ({"drawing_origin": [], "drawing_top": None}, None),
        ({"drawing_origin": {}, "drawing_top": None}, None),
        ({"drawing_origin": [0.0, 0.0], "drawing_top": "8"}, None),
        ({}, None),
        (None, None),
    ],
)
def test_a_frame_is_known_only_where_the_reading_says_which_way_y_runs(
    reading: dict[str, Any] | None, frame: DrawingFrame | None
) -> None:
    assert DrawingFrame.of_reading(reading) == frame


def test_a_frame_is_kept_as_it_was_told() -> None:
    for frame in (DrawingFrame((3.0, 4.0)), DrawingFrame((0.0, 0.0), 8.0)):
        assert DrawingFrame.of_reading(frame.to_json()) == frame
