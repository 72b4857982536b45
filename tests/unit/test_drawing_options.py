"""What is said of a drawing, through JSON, forms and new issues."""

from __future__ import annotations

import json
from typing import Any

import pytest

from service.domain.drawing_options import DrawingOptions
from service.domain.edits import MAX_VERTICES, edit_to_json, edits_of
from service.domain.errors import InvalidRequest
from service.domain.scale_hint import KnownLength, ScaleHint

SQUARE = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]
EDITS: list[dict[str, Any]] = [
    {"action": "move", "to": "wall", "strokes": ["s-1.5_2_3_4", "w1_2_3_4~2"]},
    {"action": "move", "to": "text", "within": SQUARE, "of": ["hatch", "wall"]},
    {"action": "include", "within": SQUARE},
    {"action": "exclude", "within": SQUARE},
    {"action": "add-wall", "line": [[1.0, 2.0], [3.0, 4.0]], "thickness_m": 0.2},
    {"action": "add-wall", "line": [[1.0, 2.0], [3.0, 4.0]]},
    {"action": "erase-walls", "within": SQUARE},
]
SAID: dict[str, Any] = {
    "page": 3,
    "storey": "First floor",
    "cut_height_m": 1.2,
    "wall_layers": ["A-WALL", "Wände"],
    "edits": EDITS,
    "replaces": "drw_1",
    "scale": {"known_lengths": [{"x1": 0.0, "y1": 0.0, "x2": 3.0, "y2": 4.0, "length_m": 5.0}] * 2},
}


def test_edits_go_through_json_unchanged() -> None:
    assert [edit_to_json(edit) for edit in edits_of(EDITS)] == EDITS


def test_options_go_through_json_unchanged() -> None:
    options = DrawingOptions.from_json(SAID)
    assert options.to_json() == SAID
    assert DrawingOptions.from_json(json.loads(json.dumps(options.to_json()))) == options
    assert DrawingOptions().to_json() == {}


def test_null_takes_back_what_was_said() -> None:
    options = DrawingOptions.from_json(SAID)
    assert options.changed(dict.fromkeys(SAID)) == DrawingOptions()


def test_a_form_says_the_same_as_json() -> None:
    fields = {
        "page": "3",
        "storey": "First floor",
        "cut_height_m": "1.2",
        "wall_layers": json.dumps(SAID["wall_layers"]),
        "edits": json.dumps(EDITS),
        "replaces": "drw_1",
        "known_length": "0,0,3,4,5;0,0,3,4,5",
    }
    assert DrawingOptions.from_fields(fields) == DrawingOptions.from_json(SAID)


def test_a_new_issue_keeps_what_it_does_not_say_anew() -> None:
    old = DrawingOptions.from_json(SAID)
    new = DrawingOptions(scale=ScaleHint(metres_per_unit=0.02), replaces="drw_2")
    assert new.completed_by(old) == DrawingOptions.from_json(
        {**SAID, "scale": {"metres_per_unit": 0.02}, "replaces": "drw_2"}
    )
    other = new.changed({"edits": EDITS[:1], "page": 1})
    assert (other.completed_by(old).edits, other.completed_by(old).page) == (other.edits, 1)


@pytest.mark.parametrize(
    ("value", "pointer"),
    [
        ({"wall_layers": "A-WALL"}, "#/wall_layers"),
        ({"wall_layers": ["A", ""]}, "#/wall_layers/1"),
        ({"wall_layers": ["A"] * 201}, "#/wall_layers"),
        ({"storey": "a\0b"}, "#/storey"),
        ({"cut_height_m": 0}, "#/cut_height_m"),
        ({"cut_height_m": "1.2"}, "#/cut_height_m"),
        ({"page": True}, "#/page"),
        ({"crop": [1, 2, 3, 4]}, "#/crop"),
        ({"scale": {"known_lengths": []}}, "#/scale/known_lengths"),
        ({"edits": [{"action": "include", "within": [[0, 0]] * (MAX_VERTICES + 1)}]}, "#/edits/0/within"),
        ({"edits": [{"action": "include", "within": [[0, 0]] * 5}]}, "#/edits/0/within"),
        ({"edits": [{"action": "move", "to": "wall", "strokes": ["s1_2_3"]}]}, "#/edits/0/strokes/0"),
        ({"edits": [{**EDITS[1], "of": ["clouds"]}]}, "#/edits/0/of/0"),
        ({"edits": [{**EDITS[0], "of": ["text"]}]}, "#/edits/0/of"),
        ({"edits": [{**EDITS[0], "within": SQUARE}]}, "#/edits/0"),
    ],
)
def test_what_is_wrong_is_named(value: dict[str, Any], pointer: str) -> None:
    with pytest.raises(InvalidRequest) as refused:
        DrawingOptions.from_json(value)
    assert [error["pointer"] for error in refused.value.members["errors"]] == [pointer]


def test_several_lengths_are_one_scale() -> None:
    options = DrawingOptions.from_json(SAID)
    assert options.scale is not None
    assert options.scale.known_lengths == (KnownLength(0.0, 0.0, 3.0, 4.0, 5.0),) * 2
    assert options.scale.metres_per_px() == pytest.approx(1.0)
