"""Whole forms over HTTP, sent by two admins from the same base: put together, or refused with both sides."""

from __future__ import annotations

import random
from collections import Counter
from typing import Any

import httpx
import pytest

from tests.server import ClientFor, Server
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

PAIRS = 30
PLACES = [{"x_m": x, "y_m": 0.0, "yaw_rad": yaw} for x in (0.0, 1.0) for yaw in (0.0, 0.5)]

Form = dict[str, Any]


def a_base(admin: httpx.Client, by_hand: ByHand) -> tuple[str, int]:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    layers = [{"placement_id": a_placement(admin, by_hand, map_id), "name": name} for name in "abc"]
    return map_id, a_ready_revision(admin, by_hand, map_id, base=first, layers=layers)


def form_of(revision: dict[str, Any]) -> Form:
    """Return the whole form as a client fills it in from what it is shown."""
    return {
        "base": revision["n"],
        "drawing_id": revision["drawing_id"],
        "recipe": dict(revision["recipe"]),
        "layers": [
            {"placement_id": layer["placement_id"], "name": layer["name"]} for layer in revision["layers"]
        ],
    }


def changed(draw: random.Random, form: Form, *, placements: list[str], drawings: list[str]) -> Form:
    """Return the form with a few members changed by hand."""
    recipe, layers = dict(form["recipe"]), [dict(layer) for layer in form["layers"]]
    for what in draw.sample(["height", "voxel", "floor", "place", "drawing", "name", "drop", "add"], k=2):
        if what == "height":
            recipe["wall_height_m"] = draw.choice([2.0, 3.0])
        elif what == "voxel":
            recipe["voxel_size_m"] = draw.choice([0.1, 0.2])
        elif what == "floor":
            recipe["floor"] = True
        elif what == "place":
            recipe["map_from_drawing"] = draw.choice(PLACES[1:])
        elif what == "drawing":
            form = form | {"drawing_id": draw.choice(drawings)}
        elif what == "name":
            layers[draw.randrange(len(layers))]["name"] = draw.choice(["press", "rack"])
        elif what == "drop":
            layers.pop(draw.randrange(len(layers)))
        else:
            layers.append({"placement_id": draw.choice(placements), "name": "new"})
    return form | {"recipe": recipe, "layers": layers}


def members(form: Form) -> dict[str, Any]:
    named = {f"layer {layer['placement_id']}": layer["name"] for layer in form["layers"]}
    walls = {"walls": (form["drawing_id"], form["recipe"]["map_from_drawing"])}
    rest = {name: value for name, value in form["recipe"].items() if name != "map_from_drawing"}
    return rest | named | walls


def _pairs(admins: tuple[httpx.Client, httpx.Client], by_hand: ByHand, seeds: range) -> Counter[str]:
    """Return how many pairs were put together and refused; of none was anything lost."""
    one, two = admins
    map_id, base = a_base(one, by_hand)
    more = {
        "placements": [a_placement(one, by_hand, map_id) for _ in range(2)],
        "drawings": [by_hand.drawing(map_id) for _ in range(2)],
    }
    where = f"/v1/maps/{map_id}/revisions"
    held = ok(one.get(f"{where}/{base}"))
    seen: Counter[str] = Counter()
    for seed in seeds:
        draw = random.Random(seed)
        again = form_of(held) | {"base": ok(one.get(where))["items"][0]["n"]}
        held = ok(one.post(where, json=again), 202)["revision"]  # each pair begins where the first did
        first, second = (changed(draw, form_of(held), **more) for _ in range(2))
        head = ok(one.post(where, json=first), 202)["revision"]
        answer = two.post(where, json=second)
        latest = ok(one.get(where))["items"][0]
        old, a, b, now = (members(form) for form in (form_of(held), first, second, form_of(latest)))
        names = set(old) | set(a) | set(b)
        both = {n for n in names if old.get(n) not in (a.get(n), b.get(n)) and a.get(n) != b.get(n)}
        if answer.status_code == 409:
            problem = refused(answer, 409, "stale-base")
            assert (problem["base"], problem["latest"]) == (held["n"], head["n"]), seed
            sides = [{x["subject"] for x in problem[side]} for side in ("theirs", "yours")]
            assert set(problem["overlap"]) <= sides[0] | sides[1], seed
            assert latest["n"] == head["n"], seed
            told = {layer["placement_id"] for layer in held["layers"]}
            fresh = {n for n in names if n.removeprefix("layer ") in more["placements"] and n in a and n in b}
            assert both or (fresh and not fresh & told), (seed, problem["overlap"])
            seen["refused"] += 1
            continue
        made = ok(answer, 202)
        assert not both, seed
        for name in names | set(now):
            theirs = b.get(name) if a.get(name) == old.get(name) else a.get(name)
            assert now.get(name) == theirs, (seed, name)
        assert (made["revision"]["base_n"], made["revision"]["parent_n"]) == (held["n"], head["n"]), seed
        seen["put together"] += 1
    return seen


def test_of_pairs_of_whole_forms_no_update_is_lost(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    seen = _pairs((admin, client_for("admin")), by_hand, range(PAIRS))
    assert min(seen["put together"], seen["refused"]) > PAIRS // 10, seen


@pytest.mark.postgres
def test_of_pairs_of_whole_forms_no_update_is_lost_on_postgresql(postgres_served: Server) -> None:
    admins = tuple(postgres_served.client(postgres_served.admin_key) for _ in range(2))
    seen = _pairs((admins[0], admins[1]), ByHand(postgres_served.kernel), range(1_000, 1_000 + PAIRS // 2))
    assert sum(seen.values()) == PAIRS // 2


def test_a_whole_form_from_an_old_base_leaves_what_it_does_not_change(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id, base = a_base(admin, by_hand)
    where = f"/v1/maps/{map_id}/revisions"
    form = form_of(ok(admin.get(f"{where}/{base}")))
    layer_ids = [layer["layer_id"] for layer in ok(admin.get(f"{where}/{base}"))["layers"]]
    operations = [
        {"op": "set-recipe", "recipe": {"wall_height_m": 3.5}},
        {"op": "move-layer", "layer_id": layer_ids[0], "by": {"x_m": 1.0}},
        {"op": "hide-layer", "layer_id": layer_ids[1]},
        {"op": "add-layer", "placement_id": a_placement(admin, by_hand, map_id), "name": "d"},
    ]
    theirs = ok(admin.post(where, json={"base": base, "operations": operations}), 202)["revision"]
    mine = form | {"recipe": form["recipe"] | {"voxel_size_m": 0.1}, "layers": form["layers"][:2]}
    made = ok(client_for("admin").post(where, json=mine), 202)
    revision = made["revision"]
    assert (revision["recipe"]["wall_height_m"], revision["recipe"]["voxel_size_m"]) == (3.5, 0.1)
    assert [(x["name"], x["visible"]) for x in revision["layers"]] == [("a", True), ("b", False), ("d", True)]
    assert revision["layers"][0]["T_map_scan"] == theirs["layers"][0]["T_map_scan"]
    assert [one["op"] for one in revision["operations"]] == ["set-recipe", "set-layers"]
    assert revision["operations"][0]["recipe"] == {"voxel_size_m": 0.1}
    assert {one["subject"] for one in made["rebased"]["changes"]} >= {"recipe.wall_height_m"}
    other = form | {"recipe": form["recipe"] | {"wall_height_m": 4.5}}
    problem = refused(client_for("admin").post(where, json=other), 409, "stale-base")
    assert (problem["base"], problem["overlap"]) == (base, ["recipe.wall_height_m"])
    sides = [
        next(x for x in problem[side] if x["subject"] == "recipe.wall_height_m")
        for side in ("theirs", "yours")
    ]
    assert [one["before"] for one in sides] == [{"wall_height_m": form["recipe"]["wall_height_m"]}] * 2
    assert [one["after"] for one in sides] == [{"wall_height_m": 3.5}, {"wall_height_m": 4.5}]


@pytest.mark.parametrize(
    "step",
    [
        {"op": "show-layer"},
        {"op": "rename-layer", "name": "a"},
        {"op": "move-layer", "by": {}},
        {"op": "set-recipe", "recipe": {"floor": False}},
    ],
)
def test_an_operation_that_changes_nothing_of_its_base_undoes_nothing(
    admin: httpx.Client, by_hand: ByHand, step: dict[str, Any]
) -> None:
    map_id, base = a_base(admin, by_hand)
    where = f"/v1/maps/{map_id}/revisions"
    layer_id = ok(admin.get(f"{where}/{base}"))["layers"][0]["layer_id"]
    operations = [
        {"op": "hide-layer", "layer_id": layer_id},
        {"op": "rename-layer", "layer_id": layer_id, "name": "press"},
        {"op": "move-layer", "layer_id": layer_id, "by": {"x_m": 1.0}},
        {"op": "set-recipe", "recipe": {"floor": True}},
    ]
    theirs = ok(admin.post(where, json={"base": base, "operations": operations}), 202)["revision"]
    named = step if step["op"] == "set-recipe" else step | {"layer_id": layer_id}
    made = ok(admin.post(where, json={"base": base, "operations": [named]}), 202)["revision"]
    assert (made["layers"], made["recipe"], made["operations"]) == (theirs["layers"], theirs["recipe"], [])
