"""The fleet's events: told as they happen, in their order, once; nothing is missing after a reconnect."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import httpx
import pytest

from service.domain.ids import made_at, new_id
from tests.server import ClientFor, Server
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

Event = tuple[str, str, dict[str, Any]]


def told(answer: httpx.Response) -> Iterator[Event]:
    """Give name, id and data of each event."""
    name = event_id = ""
    for line in answer.iter_lines():
        if line.startswith("event: "):
            name = line.removeprefix("event: ")
        elif line.startswith("id: "):
            event_id = line.removeprefix("id: ")
        elif line.startswith("data: "):
            yield name, event_id, json.loads(line.removeprefix("data: "))


def _story(server: Server) -> None:
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id, other = a_map(admin), a_map(admin)
    for each in (map_id, other):
        a_ready_revision(admin, by_hand, each)
    me = ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id}), 201)
    robot = server.client(me["key"])

    def publish(where: str) -> None:
        ok(admin.post(f"/v1/maps/{where}/revisions/1/publish", json={}))

    def report(state: str) -> None:
        ok(robot.post(f"/v1/robots/{me['id']}/reports", json={"revision": 1, "state": state}), 201)

    with admin.stream("GET", "/v1/events", params={"map": map_id}) as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        heard = told(answer)
        publish(other)
        publish(map_id)
        first = next(heard)
        for state in ("downloaded", "verified"):
            report(state)
        second, third = next(heard), next(heard)
    assert (first[0], first[2]["map_id"], first[2]["to_revision"]) == ("publication", map_id, 1)
    assert [(e[0], e[2]["robot_id"], e[2]["state"]) for e in (second, third)] == [
        ("report", me["id"], state) for state in ("downloaded", "verified")
    ]
    assert first[1] < second[1] < third[1]
    report("enabled")
    with admin.stream("GET", "/v1/events", headers={"Last-Event-ID": third[1]}) as answer:
        heard = told(answer)
        seen: list[Event] = []
        while not seen or seen[-1][2].get("state") != "enabled":
            seen.append(next(heard))
    ids = [event[1] for event in seen]
    assert ids == sorted(set(ids))
    assert {first[1], second[1], third[1]} < set(ids), "the last seconds come again, under the same ids"


def test_what_happens_is_told_on_sqlite(server: Server) -> None:
    _story(server)


@pytest.mark.postgres
def test_what_happens_is_told_on_postgresql(postgres_served: Server) -> None:
    _story(postgres_served)


def test_who_may_listen(admin: httpx.Client, client_for: ClientFor) -> None:
    refused(client_for("robot").get("/v1/events"), 403, "forbidden")
    stranger = client_for("tablet", [a_map(admin)])
    refused(stranger.get("/v1/events", params={"map": a_map(admin)}), 404, "map-not-found")
    for wrong in ("x", "!" * 26, "z" * 26):
        refused(admin.get("/v1/events", headers={"Last-Event-ID": wrong}), 422, "invalid-request")


def test_an_id_tells_when_it_was_made() -> None:
    moment = datetime(2026, 3, 4, 5, 6, 7, 89_000, tzinfo=UTC)
    assert made_at(new_id("pub", now=moment, entropy=bytes)) == moment
