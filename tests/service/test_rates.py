"""How many requests a key may send, polls from memory included, and what the front lets through."""

from __future__ import annotations

import re
from pathlib import Path

import httpx

from service.settings import Settings
from tests.front import fronted
from tests.server import running
from tests.service.asking import a_map, ok, refused


def test_a_key_is_refused_past_its_limit_and_no_other(tmp_path: Path) -> None:
    limit = {"GROUNDPLAN_MAX_REQUESTS_PER_KEY_PER_MINUTE": "20"}
    with running(Settings(data_dir=tmp_path), **limit) as server:
        admin = server.client(server.admin_key)
        other = server.client(ok(admin.post("/v1/keys", json={"name": "r", "role": "robot"}), 201)["key"])
        answers = [admin.get("/v1/maps") for _ in range(22)]
        assert [answer.status_code for answer in answers] == [200] * 19 + [429] * 3
        assert answers[0].headers["ratelimit-policy"] == '"key";q=20;w=60'
        left = [int(re.match(r'"key";r=(\d+);t=\d+$', one.headers["ratelimit"])[1]) for one in answers]  # type: ignore[index]
        assert left == [*range(18, -1, -1), 0, 0, 0]
        refused(answers[-1], 429, "too-many-requests")
        assert 1 <= int(answers[-1].headers["retry-after"]) <= 120
        assert answers[-1].headers["x-content-type-options"] == "nosniff"
        assert "content-security-policy" in answers[-1].headers
        with httpx.Client(base_url=server.url, cookies={"groundplan_session": server.admin_key}) as browser:
            assert browser.get("/v1/maps").status_code == 429
        assert other.get("/v1/maps").status_code == 200
        without = httpx.get(f"{server.url}/healthz")
        assert (without.status_code, without.headers.get("ratelimit")) == (200, None)


def test_polls_from_memory_count(tmp_path: Path) -> None:
    limit = {"GROUNDPLAN_MAX_REQUESTS_PER_KEY_PER_MINUTE": "10"}
    with running(Settings(data_dir=tmp_path), **limit) as server:
        admin = server.client(server.admin_key)
        path = f"/v1/maps/{a_map(admin)}/published"
        told = [admin.get(path, headers={"If-None-Match": '"none"'}).status_code for _ in range(12)]
        assert told == [404] * 9 + [429] * 3


def test_the_front_slows_who_tries_keys_and_nobody_else(tmp_path: Path) -> None:
    with (
        running(Settings(data_dir=tmp_path / "data")) as server,
        fronted(server, tmp_path / "nginx") as front,
        front.client(server.admin_key) as client,
    ):
        own = {"X-Groundplan-Session": "1"}
        tried = [client.put("/v1/session", json={"key": f"gp_{n}"}, headers=own) for n in range(60)]
        statuses = [answer.status_code for answer in tried]
        assert statuses[:20] == [401] * 20
        assert 429 in statuses
        stopped = next(answer for answer in tried if answer.status_code == 429)
        assert stopped.headers["retry-after"] == "1"
        assert {client.get("/v1/maps").status_code for _ in range(100)} == {200}
