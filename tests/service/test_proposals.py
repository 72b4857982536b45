"""Proposals to take off what a later scan looked through: accepted, dismissed, or overtaken by events."""

from __future__ import annotations

from typing import Any

import httpx

from service.db.models import Placement
from service.usecases.proposals import propose
from tests.server import ClientFor
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

REGION = {"within": [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], "z_max_m": 1.4}


def a_proposal(
    admin: httpx.Client, by_hand: ByHand, map_id: str, layer_id: str, *, whole: bool
) -> dict[str, Any]:
    """Return a proposal that a new placement makes about a layer."""
    placement_id = a_placement(admin, by_hand, map_id)
    thing = {"region": REGION, "points": 900, "still_seen": 3, "looked_through": 800}
    gone = [{"layer_id": layer_id, "name": "press", "whole_layer": whole, "things": [thing]}]
    kernel = by_hand.kernel
    for _ in range(2):
        with kernel.db.writing("record-placement") as session:
            propose(kernel, session, session.get_one(Placement, placement_id), gone)
    listed = ok(admin.get(f"/v1/maps/{map_id}/proposals", params={"state": "open"}))["items"]
    (found,) = (one for one in listed if one["placement_id"] == placement_id)
    return dict(found)


def a_map_with_layers(admin: httpx.Client, by_hand: ByHand) -> tuple[str, int, list[str]]:
    map_id = a_map(admin)
    first = a_ready_revision(admin, by_hand, map_id)
    wanted = [{"placement_id": a_placement(admin, by_hand, map_id), "name": n} for n in ("press", "rack")]
    n = a_ready_revision(admin, by_hand, map_id, base=first, layers=wanted)
    made = ok(admin.get(f"/v1/maps/{map_id}/revisions/{n}"))
    return map_id, n, [layer["layer_id"] for layer in made["layers"]]


def test_a_thing_that_has_gone_is_erased_from_its_layer_alone(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, n, (press, rack) = a_map_with_layers(admin, by_hand)
    proposal = a_proposal(admin, by_hand, map_id, press, whole=False)
    made = ok(admin.post(f"/v1/proposals/{proposal['id']}/accept"), 202)["revision"]
    (erased,) = made["erased"]
    assert (erased["region"], erased["drawing"], list(erased["layers"])) == (REGION, False, [press])
    assert [layer["layer_id"] for layer in made["layers"]] == [press, rack]
    (decided,) = ok(admin.get(f"/v1/maps/{map_id}/proposals"))["items"]
    assert (decided["state"], decided["revision_n"]) == ("accepted", n + 1)
    again = refused(admin.post(f"/v1/proposals/{proposal['id']}/dismiss"), 409, "proposal-decided")
    assert again["state"] == "accepted"
    assert len(ok(admin.get(f"/v1/maps/{map_id}/revisions"))["items"]) == n + 1


def test_a_layer_that_has_gone_is_removed(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, _, (press, rack) = a_map_with_layers(admin, by_hand)
    proposal = a_proposal(admin, by_hand, map_id, press, whole=True)
    made = ok(admin.post(f"/v1/proposals/{proposal['id']}/accept"), 202)["revision"]
    assert [layer["layer_id"] for layer in made["layers"]] == [rack]
    assert "looked through" in made["reason"]


def test_a_dismissed_proposal_leaves_the_map_as_it_is(
    admin: httpx.Client, by_hand: ByHand, client_for: ClientFor
) -> None:
    map_id, n, (press, _) = a_map_with_layers(admin, by_hand)
    proposal = a_proposal(admin, by_hand, map_id, press, whole=True)
    for verb in ("accept", "dismiss"):
        refused(
            client_for("robot", [map_id]).post(f"/v1/proposals/{proposal['id']}/{verb}"), 403, "forbidden"
        )
        other = client_for("tablet", [a_map(admin)])
        refused(other.post(f"/v1/proposals/{proposal['id']}/{verb}"), 404, "proposal-not-found")
    assert ok(admin.post(f"/v1/proposals/{proposal['id']}/dismiss"))["state"] == "dismissed"
    refused(admin.post(f"/v1/proposals/{proposal['id']}/accept"), 409, "proposal-decided")
    assert len(ok(admin.get(f"/v1/maps/{map_id}/revisions"))["items"]) == n


def test_what_happens_to_the_layer_meanwhile_settles_what_was_proposed(
    admin: httpx.Client, by_hand: ByHand
) -> None:
    map_id, n, (press, rack) = a_map_with_layers(admin, by_hand)
    about_press = a_proposal(admin, by_hand, map_id, press, whole=False)
    about_rack = a_proposal(admin, by_hand, map_id, rack, whole=False)
    other = a_placement(admin, by_hand, map_id)
    step = {"op": "replace-layer", "layer_id": press, "placement_id": other}
    ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"base": n, "operations": [step]}), 202)
    listed = ok(admin.get(f"/v1/maps/{map_id}/proposals"))["items"]
    states = {one["id"]: one["state"] for one in listed}
    assert states == {about_press["id"]: "dismissed", about_rack["id"]: "open"}
    refused(admin.post(f"/v1/proposals/{about_press['id']}/accept"), 409, "proposal-decided")
