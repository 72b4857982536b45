"""What a part of a placed scan is, as it is said and kept."""

from __future__ import annotations

from typing import Any

import pytest

from service.domain.errors import InvalidRequest
from service.domain.layer_part import LayerPart
from service.domain.region import MAX_VERTICES

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]


@pytest.mark.parametrize(
    "said",
    [
        {},
        {"points": "all"},
        {"include": [{"within": SQUARE}], "exclude": [{"within": SQUARE, "z_max_m": 1.0}]},
        {"points": "all", "exclude": [{"within": SQUARE, "z_min_m": 1.0, "z_max_m": 2.0}]},
    ],
)
def test_a_part_is_kept_as_it_was_said(said: dict[str, Any]) -> None:
    part = LayerPart.from_json(said)
    assert LayerPart.from_json(part.to_json()) == part
    assert part.to_json() == {"points": "target", "include": [], "exclude": []} | said


@pytest.mark.parametrize(
    ("said", "pointer"),
    [
        ([], "#/part"),
        ({"part": "all"}, "#/part"),
        ({"points": "some"}, "#/part/points"),
        ({"include": {}}, "#/part/include"),
        ({"include": [{}]}, "#/part/include/0/within"),
        ({"exclude": [{"within": SQUARE[:2]}]}, "#/part/exclude/0/within"),
        ({"exclude": [{"within": [[0, 0]] * (MAX_VERTICES + 1)}]}, "#/part/exclude/0/within"),
        ({"exclude": [{"within": [[0, 0], [1, "1"], [2, 2]]}]}, "#/part/exclude/0/within/1/1"),
        ({"exclude": [{"within": [[0, 0], [1, 1, 1], [2, 2]]}]}, "#/part/exclude/0/within/1"),
        ({"exclude": [{"within": SQUARE, "z_min_m": float("nan")}]}, "#/part/exclude/0/z_min_m"),
        ({"exclude": [{"within": SQUARE, "z_min_m": 2.0, "z_max_m": 1.0}]}, "#/part/exclude/0/z_max_m"),
        ({"exclude": [{"within": SQUARE, "height": 2.0}]}, "#/part/exclude/0"),
    ],
)
def test_what_is_no_part_is_refused_where_it_is_wrong(said: object, pointer: str) -> None:
    with pytest.raises(InvalidRequest) as refused:
        LayerPart.from_json(said)
    assert refused.value.members["errors"][0]["pointer"] == pointer
