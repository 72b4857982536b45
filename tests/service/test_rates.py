"""How many requests a key may send, polls from memory included, and what the front lets through."""

from __future__ import annotations

import re
from pathlib import Path

from service.api.windows import MOST_KEYS, WINDOW_S, Windows
from service.settings import Settings
from tests import web
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
        with web.Client(base_url=server.url, cookies={"groundplan_session": server.admin_key}) as browser:
            assert browser.get("/v1/maps").status_code == 429
        assert other.get("/v1/maps").status_code == 200
        without = web.get(f"{server.url}/healthz")
        assert (without.status_code, without.headers.get("ratelimit")) == (200, None)


BEARER, COOKIE = "Authorization", "Cookie"
SPELLINGS = [
    [(BEARER, "BEARER {key}")],
    [(BEARER, "bEARER   {key}")],
    [(BEARER, "Bearer {key}"), (BEARER, "Bearer gp_{n}")],
    [(BEARER, "Bearer {key}"), (BEARER, "Basic {n}")],
    [(BEARER, "Basic {n}"), (COOKIE, "groundplan_session={key}")],
    [(COOKIE, "groundplan_session={key}"), (COOKIE, "other={n}")],
    [(COOKIE, "groundplan_session={n}; groundplan_session={key}")],
    [(COOKIE, "groundplan_session={n}"), (COOKIE, "groundplan_session={key}")],
    [(COOKIE, "a[{n}]=(x); groundplan_session={key}")],
    [(COOKIE, 'groundplan_session="\\147{tail}"')],
]
"""Ways to present a key that opens the door; `n` is another number each time."""


def test_no_spelling_of_a_key_is_counted_elsewhere(tmp_path: Path) -> None:
    limit = {"GROUNDPLAN_MAX_REQUESTS_PER_KEY_PER_MINUTE": "20"}
    with running(Settings(data_dir=tmp_path), **limit) as server:
        admin, asked = server.client(server.admin_key), {"name": "r", "role": "robot"}
        for spelling in SPELLINGS:
            key = ok(admin.post("/v1/keys", json=asked), 201)["key"]
            told: list[int] = []
            while len(told) < 40 and 429 not in told:  # while it is asked, the window slides and lets more in
                n = len(told)
                headers = [(name, value.format(key=key, tail=key[1:], n=n)) for name, value in spelling]
                told.append(web.get(f"{server.url}/v1/maps", headers=headers).status_code)
            assert told[:20] == [200] * 20, spelling
            assert told[-1] == 429, spelling


def test_what_strangers_invent_takes_no_more_than_its_room() -> None:
    windows = Windows(most=3, clock=lambda: 1.0)
    for n in range(MOST_KEYS):
        windows.hit(f"stranger {n}")
    assert len(windows) == MOST_KEYS
    assert windows.hit("stranger 0").left == 1, "it is still known, and heard last now"
    windows.hit("one more")
    assert len(windows) == MOST_KEYS
    assert windows.hit("stranger 0").left == 0
    assert windows.hit("stranger 1").left == 2, "the one not heard for longest was forgotten"
    assert Settings.model_fields["max_requests_per_key_per_minute"].default < MOST_KEYS


def test_the_window_slides() -> None:
    now = [0.0]
    windows = Windows(most=60, clock=lambda: now[0])
    assert [windows.hit("key").is_within for _ in range(61)] == [True] * 60 + [False]
    assert windows.hit("key").more_in_s == WINDOW_S
    now[0] = WINDOW_S + 0.0
    assert not windows.hit("key").is_within, "all of the last window is still covered"
    now[0] = WINDOW_S + 1.0
    assert [windows.hit("key").is_within for _ in range(2)] == [True, False]
    now[0] = WINDOW_S + 30.0
    assert sum(windows.hit("key").is_within for _ in range(60)) == 29
    now[0] = 3.0 * WINDOW_S
    assert sum(windows.hit("key").is_within for _ in range(61)) == 60


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
