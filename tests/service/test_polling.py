"""Polls answered from memory: what changes is seen, here at once and by another process within a second."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import httpx
import pytest

from service.settings import Settings
from tests import web
from tests.server import Server, running, start
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

WITHIN_S = 1.0


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, Server]]:
    """Give two processes of one service."""
    with running(Settings(data_dir=tmp_path_factory.mktemp("pair"))) as first:
        second = start(first.settings, admin_key=first.admin_key)
        try:
            yield first, second
        finally:
            second.close()


def published(server: Server) -> tuple[str, httpx.Client]:
    """Return the path of a new map's pointer, which points to the first of two revisions, and an admin."""
    admin = server.client(server.admin_key)
    map_id = a_map(admin)
    for _ in range(2):
        a_ready_revision(admin, ByHand(server.kernel), map_id)
    ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
    return f"/v1/maps/{map_id}/published", admin


def until(
    poll: Callable[[], httpx.Response], *, since: float, is_stale: Callable[[httpx.Response], bool]
) -> None:
    """Poll until the answer is new; no request that was sent after the time allowed may get a stale one."""
    while True:
        sent = time.monotonic()
        if not is_stale(poll()):
            return
        assert sent - since <= WITHIN_S


def test_another_process_sees_a_publication_and_a_revoked_key_within_a_second(
    pair: tuple[Server, Server],
) -> None:
    first, second = pair
    where, admin = published(first)
    map_id = where.split("/")[3]
    made = ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id}), 201)
    robot = second.client(made["key"])
    tag = robot.get(where).headers["etag"]

    def poll() -> httpx.Response:
        return robot.get(where, headers={"If-None-Match": tag})

    for _ in range(20):
        assert poll().status_code == 304
    ok(admin.post(f"/v1/maps/{map_id}/revisions/2/publish", json={}))
    until(poll, since=time.monotonic(), is_stale=lambda answer: answer.status_code == 304)
    told = poll()
    assert ok(told)["revision"] == 2
    tag = told.headers["etag"]
    assert poll().status_code == 304
    assert admin.delete(f"/v1/keys/{made['key_id']}").status_code == 204
    until(poll, since=time.monotonic(), is_stale=lambda answer: answer.status_code == 304)
    refused(poll(), 401, "unauthenticated")


def test_the_same_process_sees_it_at_once(pair: tuple[Server, Server]) -> None:
    server = pair[0]
    where, admin = published(server)
    map_id = where.split("/")[3]
    made = ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id}), 201)
    robot = server.client(made["key"])
    for n in (2, 1, 2, 1, 2):
        tag = robot.get(where).headers["etag"]
        for _ in range(3):
            assert robot.get(where, headers={"If-None-Match": tag}).status_code == 304
        ok(admin.post(f"/v1/maps/{map_id}/revisions/{n}/publish", json={}))
        assert ok(robot.get(where, headers={"If-None-Match": tag}))["revision"] == n
    tag = robot.get(where).headers["etag"]
    admin.delete(f"/v1/keys/{made['key_id']}")
    refused(robot.get(where, headers={"If-None-Match": tag}), 401, "unauthenticated")


def test_a_poll_from_memory_is_what_the_database_would_say(pair: tuple[Server, Server]) -> None:
    server = pair[0]
    where, admin = published(server)
    tag = admin.get(where).headers["etag"]
    first, second = (admin.get(where, headers={"If-None-Match": tag}) for _ in range(2))
    headers = [{k for k in answer.headers if k != "content-length"} for answer in (first, second)]
    assert headers[0] == headers[1]
    for answer in (first, second):
        assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", tag)
    asked = {"If-None-Match": tag}
    named = admin.get(where, headers={**asked, "X-Request-Id": "poll-7"})
    assert (named.status_code, named.headers["x-request-id"]) == (304, "poll-7")
    refused(web.get(server.url + where, headers=asked), 401, "unauthenticated")
    wrong = {**asked, "Authorization": "Bearer gp_wrong"}
    refused(web.get(server.url + where, headers=wrong), 401, "unauthenticated")
    refused(admin.get(where, params={"channel": "canary"}, headers=asked), 404, "nothing-published")
    stranger = ok(admin.post("/v1/keys", json={"name": "k", "role": "robot", "map_ids": [a_map(admin)]}), 201)
    refused(server.client(stranger["key"]).get(where, headers=asked), 404, "map-not-found")
    assert admin.get(where, params={"channel": "stable"}, headers=asked).status_code == 304
    assert admin.head(where, headers=asked).status_code == 304
    assert admin.post(where, headers=asked).status_code == 405


def test_an_expired_key_polls_no_longer(pair: tuple[Server, Server]) -> None:
    server = pair[0]
    where, admin = published(server)
    soon = (datetime.now(UTC) + timedelta(seconds=1.0)).isoformat()
    made = ok(admin.post("/v1/keys", json={"name": "k", "role": "robot", "expires_at": soon}), 201)
    robot = server.client(made["key"])
    tag = robot.get(where).headers["etag"]
    assert robot.get(where, headers={"If-None-Match": tag}).status_code == 304
    time.sleep(1.1)
    refused(robot.get(where, headers={"If-None-Match": tag}), 401, "unauthenticated")
