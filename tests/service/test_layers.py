"""Operations on layers over HTTP: two people at once, what is kept, and what is refused with both sides."""

from __future__ import annotations

import threading
from typing import Any

import httpx

from service.domain.transform import Transform
from tests.server import ClientFor
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

SQUARE = {"within": [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]}


def revise(client: httpx.Client, map_id: str, base: int, *operations: dict[str, Any]) -> httpx.Response:
    body = {"base": base, "operations": list(operations), "reason": "a test"}
    return client.post(f"/v1/maps/{map_id}/revisions", json=body)


def layers(client: httpx.Client, map_id: str, n: int) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = ok(client.get(f"/v1/maps/{map_id}/revisions/{n}"))["layers"]
    return found


def three_layers(admin: httpx.Client, by_hand: ByHand) -> tuple[str, int]:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    wanted = [{"placement_id": a_placement(admin, by_hand, map_id), "name": n} for n in ("a", "b", "c")]
    return map_id, a_ready_revision(admin, by_hand, map_id, base=first, layers=wanted)


def test_a_layer_keeps_its_id_through_every_operation(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, base = three_layers(admin, by_hand)
    a, b, c = (layer["layer_id"] for layer in layers(admin, map_id, base))
    other = a_placement(admin, by_hand, map_id)
    pose = Transform.from_xyz_yaw(1.0, -2.0, 0.0, 0.3).tolist()
    answer = revise(
        admin,
        map_id,
        base,
        {"op": "move-layer", "layer_id": a, "T_map_scan": pose},
        {"op": "replace-layer", "layer_id": b, "placement_id": other},
        {"op": "remove-layer", "layer_id": c},
        {"op": "rename-layer", "layer_id": a, "name": "press"},
        {"op": "erase-region", "region": SQUARE, "layer_ids": [a]},
        {"op": "set-recipe", "recipe": {"floor": True}},
    )
    made = ok(answer, 202)["revision"]
    assert [(x["layer_id"], x["name"]) for x in made["layers"]] == [(a, "press"), (b, "b")]
    assert made["layers"][0]["T_map_scan"] == pose
    assert made["layers"][1]["placement_id"] == other
    assert (made["recipe"]["floor"], made["reason"], made["parent_n"]) == (True, "a test", base)
    assert [one["op"] for one in made["operations"]][:3] == ["move-layer", "replace-layer", "remove-layer"]
    (region,) = made["erased"]
    assert (region["drawing"], list(region["layers"])) == (True, [a])
    by_hand.build(made["job_id"])
    back = revise(admin, map_id, made["n"], {"op": "restore-region", "region_id": region["region_id"]})
    assert ok(back, 202)["revision"]["erased"] == []
    assert [x["name"] for x in layers(admin, map_id, base)] == ["a", "b", "c"], "the base stays as it was"


def test_a_hidden_layer_stays_in_the_revision(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, base = three_layers(admin, by_hand)
    a = layers(admin, map_id, base)[0]["layer_id"]
    hidden = ok(revise(admin, map_id, base, {"op": "hide-layer", "layer_id": a}), 202)["revision"]
    assert [x["visible"] for x in hidden["layers"]] == [False, True, True]
    shown = ok(revise(admin, map_id, hidden["n"], {"op": "show-layer", "layer_id": a}), 202)["revision"]
    assert [x["visible"] for x in shown["layers"]] == [True, True, True]


def test_what_two_people_do_to_different_things_is_put_together(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, base = three_layers(admin, by_hand)
    a, b, _ = (layer["layer_id"] for layer in layers(admin, map_id, base))
    first = ok(revise(admin, map_id, base, {"op": "remove-layer", "layer_id": a}), 202)
    assert first["rebased"] is None
    shift = {"op": "move-layer", "layer_id": b, "by": {"x_m": 0.5}}
    second = ok(revise(admin, map_id, base, shift), 202)
    assert (second["rebased"]["base"], second["rebased"]["onto"]) == (base, first["revision"]["n"])
    assert [(x["subject"], x["change"]) for x in second["rebased"]["changes"]] == [
        (f"layer.{a}", "removed"),
        (f"scan.{layers(admin, map_id, base)[0]['scan_id']}", "removed"),
    ]
    revision = second["revision"]
    assert (revision["base_n"], revision["parent_n"]) == (base, first["revision"]["n"])
    assert [x["name"] for x in revision["layers"]] == ["b", "c"]
    assert revision["layers"][0]["T_map_scan"][0][3] == 0.5


def test_what_two_people_do_to_the_same_thing_is_refused_with_both_sides(
    admin: httpx.Client, by_hand: ByHand
) -> None:
    map_id, base = three_layers(admin, by_hand)
    a = layers(admin, map_id, base)[0]["layer_id"]
    ok(revise(admin, map_id, base, {"op": "move-layer", "layer_id": a, "by": {"x_m": 1.0}}), 202)
    problem = refused(revise(admin, map_id, base, {"op": "remove-layer", "layer_id": a}), 409, "stale-base")
    assert (problem["latest"], problem["overlap"]) == (base + 1, [f"layer.{a}"])
    assert [one["change"] for one in problem["theirs"]] == ["moved"]
    assert [one["change"] for one in problem["yours"]] == ["removed", "removed"]
    assert len(ok(admin.get(f"/v1/maps/{map_id}/revisions"))["items"]) == base + 1


def test_two_at_the_very_same_moment_make_two_revisions_or_one(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id, base = three_layers(admin, by_hand)
    ids = [layer["layer_id"] for layer in layers(admin, map_id, base)]
    answers: list[httpx.Response] = []

    def ask(layer_id: str, metres: float) -> None:
        step = {"op": "move-layer", "layer_id": layer_id, "by": {"x_m": metres}}
        answers.append(revise(client_for("admin"), map_id, base, step))

    asked = [threading.Thread(target=ask, args=(ids[k % 3], 1.0 + k)) for k in range(6)]
    for thread in asked:
        thread.start()
    for thread in asked:
        thread.join()
    assert sorted(answer.status_code for answer in answers) == [202, 202, 202, 409, 409, 409]
    numbers = sorted(answer.json()["revision"]["n"] for answer in answers if answer.status_code == 202)
    assert numbers == [base + 1, base + 2, base + 3]
    moved = [layer["T_map_scan"][0][3] for layer in layers(admin, map_id, base + 3)]
    assert all(metres in {1.0 + k, 4.0 + k} for k, metres in enumerate(moved)), moved


def test_wrong_operations_are_pointed_at(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, base = three_layers(admin, by_hand)
    a = layers(admin, map_id, base)[0]["layer_id"]
    refused(revise(admin, map_id, base, {"op": "explode"}), 422, "invalid-request")
    refused(revise(admin, map_id, base, {"op": "move-layer", "layer_id": a}), 422, "invalid-request")
    sheared = [[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    step = {"op": "move-layer", "layer_id": a, "T_map_scan": sheared}
    assert "shears" in refused(revise(admin, map_id, base, step), 422, "invalid-request")["detail"]
    refused(revise(admin, map_id, base, {"op": "remove-layer", "layer_id": "lyr_0"}), 404, "layer-not-found")
    step = {"op": "restore-region", "region_id": "ers_0"}
    refused(revise(admin, map_id, base, step), 404, "region-not-found")
    answer = admin.post(
        f"/v1/maps/{map_id}/revisions", json={"operations": [{"op": "remove-layer", "layer_id": a}]}
    )
    assert refused(answer, 422, "invalid-request")["errors"][0]["pointer"] == "#/base"
    assert len(ok(admin.get(f"/v1/maps/{map_id}/revisions"))["items"]) == base


def test_a_scan_is_accepted_while_its_base_is_superseded(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    one, two = (a_placement(admin, by_hand, map_id) for _ in range(2))
    ok(admin.post(f"/v1/placements/{one}/accept"), 202)
    late = ok(admin.post(f"/v1/placements/{two}/accept"), 202)
    assert (late["rebased"]["base"], late["rebased"]["onto"]) == (first, first + 1)
    assert len(late["revision"]["layers"]) == 2
    refused(admin.post(f"/v1/placements/{two}/accept"), 409, "placement-not-acceptable")


def test_a_scan_placed_on_walls_that_changed_since_wants_a_look(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    placed = a_placement(admin, by_hand, map_id)
    turn = {"op": "set-recipe", "recipe": {"map_from_drawing": {"yaw_rad": 0.5}}}
    ok(revise(admin, map_id, first, turn), 202)
    problem = refused(admin.post(f"/v1/placements/{placed}/accept"), 409, "placement-not-acceptable")
    assert (problem["n"], "walls were changed" in problem["detail"]) == (first + 1, True)
    taken = ok(admin.post(f"/v1/placements/{placed}/accept", json={"reviewed": True}), 202)
    assert taken["revision"]["recipe"]["map_from_drawing"]["yaw_rad"] == 0.5


def test_every_change_is_in_the_audit_log(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id, base = three_layers(admin, by_hand)
    a = layers(admin, map_id, base)[0]["layer_id"]
    made = ok(revise(admin, map_id, base, {"op": "remove-layer", "layer_id": a}), 202)["revision"]
    by_hand.build(made["job_id"])
    ok(admin.post(f"/v1/maps/{map_id}/revisions/{made['n']}/publish", json={"reason": "the press went"}))
    ok(admin.patch(f"/v1/maps/{map_id}", json={"name": f"renamed {map_id}"}))
    entries = ok(admin.get("/v1/audit", params={"map": map_id, "limit": 200}))["items"]
    assert [one["action"] for one in entries][:3] == ["change-map", "publish", "revise"]
    assert entries[1]["after"]["reason"] == "the press went"
    assert entries[2]["after"]["operations"] == [{"op": "remove-layer", "layer_id": a}]
    assert entries[2]["before"] == {"n": base}
    assert entries[-1]["action"] == "create-map"
    who = {one["key_id"] for one in entries}
    assert len(who) == 1
    only = ok(admin.get("/v1/audit", params={"map": map_id, "action": "publish"}))["items"]
    assert [one["action"] for one in only] == ["publish"]
    other = client_for("admin", [a_map(admin)])
    assert {one["map_id"] for one in ok(other.get("/v1/audit"))["items"]} != {map_id}
    assert map_id not in {one["map_id"] for one in ok(other.get("/v1/audit"))["items"]}
    for role in ("tablet", "robot"):
        refused(client_for(role).get("/v1/audit"), 403, "forbidden")


def test_a_placement_that_needed_a_review_closes_a_gate(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    placed = a_placement(admin, by_hand, map_id, verdict="needs-review")
    wanted = [{"placement_id": placed, "name": "press", "reviewed": True}]
    n = a_ready_revision(admin, by_hand, map_id, base=first, layers=wanted)
    where = f"/v1/maps/{map_id}/revisions/{n}"
    problem = refused(admin.post(f"{where}/publish", json={}), 409, "gates-closed")
    assert [gate["code"] for gate in problem["gates"]] == ["placement-not-accepted"]
    assert ok(admin.get(f"{where}/gates"))["gates"] == problem["gates"]
    refused(admin.get(f"/v1/maps/{map_id}/published"), 404, "nothing-published")
    override = {"override": {"reason": "looked at it on site"}}
    ok(admin.post(f"{where}/publish", json=override))
    (move,) = ok(admin.get(f"/v1/maps/{map_id}/publications"))["items"]
    assert (move["to_n"], move["reason"], move["rolled_back"]) == (n, "looked at it on site", False)
    assert [gate["code"] for gate in move["overridden"]] == ["placement-not-accepted"]
    ok(admin.post(f"/v1/maps/{map_id}/revisions/{first}/publish", json={}))
    back = ok(admin.post(f"{where}/publish", json={}))
    assert back["revision"] == n, "a revision that was on the channel passes"
    moves = ok(admin.get(f"/v1/maps/{map_id}/publications"))["items"]
    assert [(m["from_n"], m["to_n"], m["rolled_back"]) for m in moves] == [
        (first, n, False),
        (n, first, True),
        (None, n, False),
    ]
    assert [c["name"] for c in ok(admin.get(f"/v1/maps/{map_id}/channels"))["channels"]] == ["stable"]


def test_a_layer_tells_who_took_it_in_whoever_changes_the_map_later(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    tablet = client_for("tablet", [map_id])
    made = ok(tablet.post(f"/v1/placements/{a_placement(admin, by_hand, map_id)}/accept"), 202)["revision"]
    by_hand.build(made["job_id"])
    (layer,) = layers(admin, map_id, made["n"])
    who = (layer["accepted_by"], layer["accepted_at"])
    assert who == (made["created_by"], made["created_at"])
    renamed = {"op": "rename-layer", "layer_id": layer["layer_id"], "name": "press"}
    later = ok(revise(admin, map_id, 2, renamed), 202)["revision"]
    by_hand.build(later["job_id"])
    (kept,) = later["layers"]
    assert later["created_by"] != made["created_by"]
    assert (kept["name"], kept["accepted_by"], kept["accepted_at"]) == ("press", *who)
    form = [{"placement_id": layer["placement_id"], "name": "as it was"}]
    same = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"base": 3, "layers": form}), 202)["revision"]
    by_hand.build(same["job_id"])
    assert same["layers"][0]["accepted_by"] == who[0]
    other = a_placement(admin, by_hand, map_id)
    swapped = {"op": "replace-layer", "layer_id": layer["layer_id"], "placement_id": other}
    new = ok(revise(admin, map_id, 4, swapped), 202)["revision"]
    told = new["layers"][0]
    assert (told["accepted_by"], told["accepted_at"]) == (new["created_by"], new["created_at"])
