"""Event streams of two service processes on one database: told across, ended with their keys, capped."""

from __future__ import annotations

import resource
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import psutil
import psycopg
import pytest

from service.api.live import (
    LOOK_AT_LEAST_EVERY_S,
    PAUSE_S,
    QUEUE,
    TICK_S,
    TRUSTED_S,
    Listener,
    Message,
    Topic,
)
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.settings import Settings
from tests import web
from tests.patience import PATIENCE_S, soon
from tests.server import Server, new_client, running, start
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

ENDED_WITHIN_S = 5.0


class Heard:
    """Listen to one stream in a thread, until it ends or is left.

    Parameters
    ----------
    client : httpx.Client
        Who listens.
    path : str
        To what.
    """

    def __init__(self, client: httpx.Client, path: str, **headers: str) -> None:
        self.names: list[str] = []
        self.has_ended = False
        self._news = threading.Condition()
        opened = threading.Event()

        def listen() -> None:
            with (
                suppress(httpx.HTTPError, httpx.StreamError),  # left by this side, or broken: not ended
                client.stream("GET", path, headers=headers, timeout=PATIENCE_S) as answer,
            ):
                assert answer.status_code == 200
                opened.set()
                for line in answer.iter_lines():
                    if line.startswith("event: "):
                        with self._news:
                            self.names.append(line.removeprefix("event: "))
                            self._news.notify_all()
                self.has_ended = True

        self.thread = threading.Thread(target=listen, daemon=True)
        self.thread.start()
        assert opened.wait(PATIENCE_S)

    def wait_for(self, *names: str) -> None:
        """Pass when exactly these events were told."""
        with self._news:
            assert self._news.wait_for(lambda: len(self.names) >= len(names), PATIENCE_S)
            assert self.names == list(names)

    def wait_for_the_end(self) -> None:
        """Pass when the stream was ended by the service, as an answer ends."""
        self.thread.join(PATIENCE_S)
        assert self.has_ended


@contextmanager
def two_services(settings: Settings, **more: str) -> Iterator[tuple[Server, Server]]:
    """Run two service processes on one database and one folder."""
    with running(settings, **more) as one:
        two = start(settings, admin_key=one.admin_key, **more)
        try:
            yield one, two
        finally:
            two.close()


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> Settings:
    """Give settings of a service on either database."""
    if request.param == "sqlite":
        return Settings(data_dir=tmp_path / "data")
    return Settings(data_dir=tmp_path / "data", database_url=request.getfixturevalue("postgres_url"))


def _a_published_map(server: Server) -> tuple[str, str]:
    """Return a map with a ready revision, and a job that waits."""
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    by_hand.drawing(map_id, read=False)
    waiting = ok(admin.get("/v1/jobs", params={"state": "queued"}))["items"]
    return map_id, next(job["id"] for job in waiting if job["map_id"] == map_id)


def test_what_one_process_writes_all_listeners_of_the_other_hear(settings: Settings) -> None:
    with two_services(settings) as (one, two):
        map_id, job_id = _a_published_map(one)
        other, _ = _a_published_map(one)
        fleet = [Heard(new_client(one, "tablet"), "/v1/events") for _ in range(3)]
        limited = Heard(new_client(one, "tablet", maps=[map_id]), "/v1/events")
        narrowed = Heard(one.client(one.admin_key), f"/v1/events?map={map_id}")
        elsewhere = Heard(one.client(one.admin_key), f"/v1/events?map={other}")
        job = [Heard(new_client(one, "tablet"), f"/v1/jobs/{job_id}/events") for _ in range(3)]
        admin = two.client(one.admin_key)
        ok(admin.post(f"/v1/jobs/{job_id}/cancel"), 202)
        for each in job:
            each.wait_for("job", "job")
            each.wait_for_the_end()
        ok(admin.post(f"/v1/maps/{other}/revisions/1/publish", json={}))
        elsewhere.wait_for("publication")
        ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
        for each in (limited, narrowed):
            each.wait_for("publication")
        for each in fleet:
            each.wait_for("publication", "publication")
        for server in (one, two):
            assert server.stop() == 0
        for each in (*fleet, limited, narrowed, elsewhere):
            each.wait_for_the_end()


def test_a_row_that_cannot_be_read_ends_no_streams_for_good(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data")
    with running(settings) as server:
        map_id, job_id = _a_published_map(server)
        listener = Heard(server.client(server.admin_key), f"/v1/jobs/{job_id}/events")
        listener.wait_for("job")
        log = settings.data_dir / "service.log"
        for problem, told in (("{", True), (None, False)):
            with closing(sqlite3.connect(settings.data_dir / "groundplan.sqlite3", timeout=30)) as raw, raw:
                raw.execute("UPDATE jobs SET problem = ?, changed = changed + 1", [problem])
            if told:
                soon(lambda: "listeners could not be looked for" in log.read_text())
        later = Heard(server.client(server.admin_key), "/v1/events")
        ok(server.client(server.admin_key).post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
        later.wait_for("publication")


def test_a_key_revoked_in_another_process_ends_its_streams_and_no_other(settings: Settings) -> None:
    with two_services(settings) as (one, two):
        map_id, job_id = _a_published_map(one)
        admin = two.client(one.admin_key)
        made = ok(admin.post("/v1/keys", json={"name": "leaves", "role": "tablet"}), 201)
        leaves, stays = one.client(made["key"]), new_client(one, "tablet")
        signed_in = web.Client(base_url=one.url, cookies={"groundplan_session": made["key"]})
        theirs = [
            Heard(leaves, "/v1/events"),
            Heard(leaves, f"/v1/jobs/{job_id}/events"),
            Heard(signed_in, "/v1/events"),
        ]
        others = [Heard(stays, "/v1/events"), Heard(stays, f"/v1/jobs/{job_id}/events")]
        assert admin.delete(f"/v1/keys/{made['id']}").status_code == 204
        for each in theirs:
            each.wait_for_the_end()
        refused(leaves.get("/v1/events"), 401, "unauthenticated")
        ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
        others[0].wait_for("publication")
        assert not any(each.has_ended for each in others)
        signed_in.close()


def test_a_stream_ends_within_seconds_of_its_key_by_the_service_s_own_intervals() -> None:
    """Look at what bounds it: a busy machine takes longer, and the benchmark of listeners takes the time."""
    by_a_look = LOOK_AT_LEAST_EVERY_S + PAUSE_S
    without_a_look = TRUSTED_S + TICK_S
    assert by_a_look < TRUSTED_S
    assert without_a_look <= ENDED_WITHIN_S


def test_a_key_that_expires_ends_its_streams(settings: Settings) -> None:
    with running(settings) as server:
        _, job_id = _a_published_map(server)
        until = datetime.now(UTC) + timedelta(seconds=3)
        body = {"name": "visitor", "role": "tablet", "expires_at": until.isoformat()}
        visitor = server.client(ok(server.client(server.admin_key).post("/v1/keys", json=body), 201)["key"])
        for each in [Heard(visitor, "/v1/events"), Heard(visitor, f"/v1/jobs/{job_id}/events")]:
            each.wait_for_the_end()
        assert datetime.now(UTC) >= until
        refused(visitor.get("/v1/events"), 401, "unauthenticated")


def test_a_key_has_so_many_streams_and_no_more(settings: Settings) -> None:
    with running(settings, GROUNDPLAN_MAX_STREAMS_PER_KEY="2") as server:
        _, job_id = _a_published_map(server)
        tablet, other = new_client(server, "tablet"), new_client(server, "tablet")
        with tablet.stream("GET", "/v1/events"), tablet.stream("GET", f"/v1/jobs/{job_id}/events"):
            for path in ("/v1/events", f"/v1/jobs/{job_id}/events"):
                answer = tablet.get(path)
                assert refused(answer, 429, "too-many-streams")["max_streams"] == 2
                assert int(answer.headers["retry-after"]) > 0
            for _ in range(3):  # what is refused takes no place
                refused(other.get("/v1/jobs/job_x/events"), 404, "job-not-found")
                refused(other.get("/v1/events", headers={"Last-Event-ID": "x"}), 422, "invalid-request")
            with other.stream("GET", "/v1/events") as answer:
                assert answer.status_code == 200
        soon(lambda: _status(tablet) == 200, "a place is free again when its client has gone")


def _status(client: httpx.Client) -> int:
    with client.stream("GET", "/v1/events") as answer:
        return answer.status_code


@pytest.mark.postgres
def test_streams_outlive_cut_connections(postgres_url: str, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", database_url=postgres_url)
    with running(settings) as server:
        map_id, _ = _a_published_map(server)
        admin = server.client(server.admin_key)
        heard = Heard(new_client(server, "tablet"), "/v1/events")
        with psycopg.connect(postgres_url.replace("+psycopg", ""), autocommit=True) as connection:
            connection.execute(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity"
                " WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
        deadline = time.monotonic() + PATIENCE_S
        while (answer := admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={})).status_code == 503:
            assert time.monotonic() < deadline
        ok(answer)
        heard.wait_for("publication")


@pytest.mark.postgres
def test_no_stream_outlives_keys_that_cannot_be_checked(postgres_url: str, tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", database_url=postgres_url)
    with running(settings) as server:
        heard = Heard(new_client(server, "tablet"), "/v1/events")
        with psycopg.connect(postgres_url.replace("+psycopg", "")) as connection:
            connection.execute("LOCK TABLE keys IN ACCESS EXCLUSIVE MODE")
            heard.wait_for_the_end()


def test_many_streams_open_more_files_than_a_shell_allows(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(256, hard), hard))
    try:
        with running(Settings(data_dir=tmp_path)) as server:
            limits = psutil.Process(server.process.pid).rlimit(psutil.RLIMIT_NOFILE)
            assert limits == (hard, hard)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


async def _slow(told: int) -> list[str]:
    listener = Listener(Actor("key_x", Role.TABLET), Topic())
    for number in range(told):
        listener.put(Message(str(number), lambda: ": x"))
    marks: list[str] = []
    async for message in listener.messages():
        marks.append(message.mark)
        if len(marks) == told:
            break
    return marks


@pytest.mark.parametrize(("told", "kept"), [(QUEUE, QUEUE), (QUEUE + 1, 0)])
def test_who_reads_too_slowly_is_cut_off(told: int, kept: int) -> None:
    import anyio  # noqa: PLC0415 - the one test without a server

    marks: Any = anyio.run(_slow, told)
    assert len(marks) == kept
