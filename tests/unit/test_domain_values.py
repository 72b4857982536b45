"""Recipes, scale hints, ids and refusals."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta

import pytest

from service.domain import errors
from service.domain.ids import new_id
from service.domain.recipe import MapFromDrawing, Recipe
from service.domain.scale_hint import KnownLength, ScaleHint


def test_a_recipe_goes_through_json_unchanged() -> None:
    recipe = Recipe(voxel_size_m=0.1, floor=True, map_from_drawing=MapFromDrawing(1.0, 2.0, 0.5))
    assert Recipe.from_json(json.loads(json.dumps(recipe.to_json()))) == recipe


@pytest.mark.parametrize(
    "field",
    [
        {"voxel_size_m": 0.0},
        {"voxel_size_m": float("nan")},
        {"wall_height_m": 1e9},
        {"walls": 3},
        {"voxel_size_m": "0.4"},
    ],
)
def test_a_recipe_out_of_its_limits_is_refused_with_a_pointer(field: dict[str, object]) -> None:
    with pytest.raises(errors.InvalidRequest) as refusal:
        Recipe.from_json(field)
    assert refusal.value.members["errors"][0]["pointer"] == "#/" + next(iter(field))


@pytest.mark.parametrize(
    ("hint", "metres_per_px"),
    [
        (ScaleHint(metres_per_unit=0.01), 0.01),
        (ScaleHint(ratio=100, dpi=254), 0.01),
        (ScaleHint(known_length=KnownLength(0, 0, 300, 400, 5.0)), 0.01),
        (ScaleHint(known_lengths=(KnownLength(0, 0, 300, 400, 5.0), KnownLength(0, 0, 9, 0, 0.09))), 0.01),
    ],
)
def test_each_way_to_give_the_scale_gives_metres_per_pixel(hint: ScaleHint, metres_per_px: float) -> None:
    assert hint.metres_per_px() == pytest.approx(metres_per_px)
    assert ScaleHint.from_json(json.loads(json.dumps(hint.to_json()))) == hint


@pytest.mark.parametrize(
    "hint",
    [
        ScaleHint(),
        ScaleHint(metres_per_unit=0.01, ratio=100, dpi=300),
        ScaleHint(ratio=100),
        ScaleHint(metres_per_unit=-1),
        ScaleHint(metres_per_unit=float("inf")),
        ScaleHint(known_length=KnownLength(5, 5, 5, 5, 1.0)),
        ScaleHint(known_length=KnownLength(0, 0, 1, 1, 0.0)),
        ScaleHint(known_lengths=(KnownLength(0, 0, 9, 0, 0.09), KnownLength(5, 5, 5, 5, 1.0))),
        ScaleHint(known_length=KnownLength(0, 0, 1, 0, 1), known_lengths=(KnownLength(0, 0, 1, 0, 1),)),
    ],
)
def test_a_scale_that_says_nothing_or_too_much_is_refused(hint: ScaleHint) -> None:
    with pytest.raises(errors.InvalidRequest):
        hint.metres_per_px()


def test_ids_sort_by_the_time_they_were_made() -> None:
    start = datetime(2026, 1, 1, tzinfo=UTC)
    ids = [
        new_id("job", now=start + timedelta(milliseconds=k), entropy=lambda n: b"\xff" * n) for k in range(50)
    ]
    assert ids == sorted(ids)
    assert all(len(name) == len("job_") + 26 for name in ids)


def test_a_refusal_is_a_problem_with_its_members() -> None:
    refusal = errors.UploadTooLarge(
        "The file has 3 bytes more than the 10 that are taken.", max_upload_bytes=10
    )
    assert refusal.problem() == {
        "slug": "upload-too-large",
        "title": "The upload is too large",
        "detail": "The file has 3 bytes more than the 10 that are taken.",
        "max_upload_bytes": 10,
    }
