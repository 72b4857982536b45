"""What the logs of the processes keep to themselves when something fails, as JSON and at a terminal."""

from __future__ import annotations

import fcntl
import os
import struct
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest
from sqlalchemy import text

from service.settings import Settings
from tests.forked import forked
from tests.patience import PATIENCE_S, soon
from tests.server import Server, environment, start
from tests.service.asking import a_map, a_ready_revision, ok
from tests.service.by_hand import ByHand

LOOPBACK = {"GROUNDPLAN_WEBHOOK_NETWORKS": "127.0.0.0/8"}
_WIDE = 2000
"""Columns of the terminal: nothing that is looked for is broken by the end of a line."""


@dataclass
class Told:
    """Hold where a process is to write its log, and what it has written."""

    open: Callable[[], IO[str]]
    read: Callable[[], str]


@contextmanager
def _a_file(folder: Path) -> Iterator[Told]:
    log = folder / "told.log"
    log.touch()
    yield Told(lambda: log.open("a", encoding="utf-8"), lambda: log.read_text(encoding="utf-8"))


@contextmanager
def _a_terminal(_folder: Path) -> Iterator[Told]:
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 50, _WIDE, 0, 0))
    seen = bytearray()

    def read() -> None:
        while True:
            try:
                seen.extend(os.read(ours, 1 << 16))
            except OSError:  # the last that could write has ended
                return

    reader = threading.Thread(target=read)
    reader.start()
    try:
        yield Told(lambda: os.fdopen(os.dup(theirs), "w"), seen.decode)
    finally:
        os.close(theirs)
        reader.join(PATIENCE_S)
        os.close(ours)


@pytest.fixture(params=[_a_file, _a_terminal], ids=["json", "terminal"])
def told(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Told]:
    """Give the log of the processes of a test."""
    with request.param(tmp_path) as made:
        yield made


@pytest.fixture
def server(told: Told, tmp_path: Path) -> Iterator[Server]:
    """Give a service that logs there."""
    more = {**LOOPBACK, "COLUMNS": str(_WIDE)}
    started = start(Settings(data_dir=tmp_path / "data"), stderr=told.open(), **more)
    yield started
    started.close()


def _change(server: Server, statement: str, **values: str) -> None:
    with server.kernel.db.engine.begin() as connection:
        connection.execute(text(statement), values)


def test_a_defect_tells_its_trace_and_not_the_key_that_asked(server: Server, told: Told) -> None:
    admin = server.client(server.admin_key)
    map_id = a_map(admin)
    made = ok(admin.post("/v1/keys", json={"name": "broken", "role": "robot"}), 201)
    _change(server, "UPDATE keys SET map_ids = 'no JSON' WHERE id = :id", id=made["id"])
    for path in (f"/v1/maps/{map_id}/published", "/v1/maps"):
        assert server.client(made["key"]).get(path).status_code == 500
    soon(lambda: told.read().count("JSONDecodeError") >= 2)
    assert "_from_database" in told.read()
    assert made["key"] not in told.read()
    assert server.admin_key not in told.read()


def test_a_statement_that_fails_is_told_without_what_it_was_given(server: Server, told: Told) -> None:
    admin = server.client(server.admin_key)
    stop = "BEGIN SELECT RAISE(ABORT, 'no hooks today'); END"
    _change(server, f"CREATE TRIGGER stop BEFORE INSERT ON webhooks {stop}")
    hook = {"url": "http://127.0.0.1:9/hook", "events": ["revision.ready"]}
    assert admin.post("/v1/webhooks", json=hook).status_code == 500
    soon(lambda: told.read().count("INSERT INTO webhooks"))
    assert "whsec_" not in told.read()


def test_a_delivery_that_fails_tells_its_trace_and_not_the_secret(server: Server, told: Told) -> None:
    admin = server.client(server.admin_key)
    hook = {"url": "http://127.0.0.1:9/hook", "events": ["revision.ready"]}
    made = ok(admin.post("/v1/webhooks", json=hook), 201)
    secret = "whsec_" + "A" * 13  # one letter more than base64 can have, so that signing fails
    _change(server, "UPDATE webhooks SET secret = :secret WHERE id = :id", secret=secret, id=made["id"])
    a_ready_revision(admin, ByHand(server.kernel), a_map(admin))
    surroundings = environment(server.settings, **LOOPBACK, COLUMNS=str(_WIDE))
    with told.open() as sink:
        worker = forked("worker", env=surroundings, stderr=sink)
    try:
        soon(lambda: "a defect ended" in told.read() and "base64-encoded" in told.read(), told.read)
    finally:
        worker.terminate()
        worker.wait(PATIENCE_S)
    assert "deliver_webhooks" in told.read()
    assert secret not in told.read()
