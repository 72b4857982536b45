"""`groundplan up` keeps its processes running, at one address, until that is of no use."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import psutil
import pytest

from tests import web
from tests.patience import PATIENCE_S, soon
from tests.service.asking import a_map, ok
from worker.cli import supervision
from worker.cli.supervision import Supervisor, how_ended

SQUARE = b"""0
SECTION
2
ENTITIES
""" + b"".join(
    b"0\nLINE\n8\nWALL\n10\n%d\n20\n%d\n11\n%d\n21\n%d\n" % line
    for line in ((0, 0, 9000, 0), (9000, 0, 9000, 6000), (9000, 6000, 0, 6000), (0, 6000, 0, 0))
) + b"0\nENDSEC\n0\nEOF\n"  # fmt: skip


@dataclass(frozen=True)
class Up:
    """Hold a running `groundplan up` and what it has said."""

    process: subprocess.Popen[bytes]
    log: Path

    @property
    def said(self) -> str:
        """Return all that it and its processes have said."""
        return self.log.read_text(encoding="utf-8")

    def first(self, pattern: str) -> str:
        """Return what it says, as soon as it does."""

        def look() -> str | None:
            found = re.search(pattern, self.said)
            assert found or self.process.poll() is None, self.said
            return found.group(1) if found else None

        told: str = soon(look, patience_s=PATIENCE_S)
        return told

    def child(self, name: str, *, other_than: int = 0) -> int:
        """Return the process id of the service or the worker, as soon as there is one."""
        words = {"service": ["-m", "service", "serve"], "worker": ["-m", "worker"]}[name]

        def look() -> int | None:
            found = [c.pid for c in psutil.Process(self.process.pid).children() if _command(c) == words]
            return next((pid for pid in found if pid != other_than), None)

        pid: int = soon(look, patience_s=PATIENCE_S)
        return pid


def _command(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()[1:]
    except psutil.Error:
        return []


@contextmanager
def up(folder: Path, *, port: int = 0) -> Iterator[Up]:
    """Run `groundplan up`; it must not outlive the test, and its processes must not outlive it."""
    log = folder / "up.log"
    command = [
        sys.executable,
        "-m",
        "worker.cli",
        "up",
        "--data-dir",
        str(folder / "data"),
        "--port",
        str(port),
    ]
    with log.open("wb") as sink:
        process = subprocess.Popen(command, stdout=sink, stderr=subprocess.STDOUT)
    children: list[psutil.Process] = []
    try:
        yield Up(process, log)
        if process.poll() is None:
            children = psutil.Process(process.pid).children(recursive=True)
            process.terminate()
            assert process.wait(40) == 0, log.read_text(encoding="utf-8")
    finally:
        process.kill()
        process.wait()
    assert not [child for child in children if child.is_running() and child.status() != "zombie"]


def test_what_is_killed_is_started_again_at_the_same_address(tmp_path: Path) -> None:
    with up(tmp_path) as running:
        address = running.first(r"listens at (http://\S+)")
        key = running.first(r"First admin key, shown this once: (\S+)")
        service, worker = running.child("service"), running.child("worker")
        psutil.Process(service).send_signal(signal.SIGKILL)
        running.first(r"(the service ended by itself \(killed by SIGKILL\); it is started again in 0.5 s)")
        assert running.child("service", other_than=service) != service
        soon(lambda: _answers(address), patience_s=PATIENCE_S)
        assert running.child("worker") == worker, "the other one goes on"
        psutil.Process(worker).send_signal(signal.SIGKILL)
        running.child("worker", other_than=worker)
        with web.Client(base_url=address, headers={"Authorization": f"Bearer {key}"}) as admin:
            sent = {"file": ("plan.dxf", SQUARE)}
            made = ok(admin.post(f"/v1/maps/{a_map(admin)}/drawings", files=sent), 202)
            where = f"/v1/jobs/{made['job']['id']}"
            soon(lambda: ok(admin.get(where))["state"] in {"succeeded", "failed"}, patience_s=PATIENCE_S)
            assert ok(admin.get(where))["state"] == "succeeded"
    assert running.said.count("First admin key") == 1


def _answers(address: str) -> bool:
    try:
        return web.get(f"{address}/readyz").status_code == 200
    except httpx.TransportError:
        return False


def test_what_dies_again_and_again_is_given_up_with_the_other(tmp_path: Path) -> None:
    with up(tmp_path) as running:
        running.first(r"(listens at)")
        worker, service = running.child("worker"), 0
        for _ in range(supervision.DEATHS):
            service = running.child("service", other_than=service)
            psutil.Process(service).send_signal(signal.SIGKILL)
        assert running.process.wait(PATIENCE_S) == 1
    assert "the service ended by itself (killed by SIGKILL), 5 times within 120 s: given up" in running.said
    assert not psutil.pid_exists(worker)


def test_stopped_while_a_new_start_is_due_it_ends_at_once(tmp_path: Path) -> None:
    with up(tmp_path) as running:
        running.first(r"(listens at)")
        service = 0
        for _ in range(3):
            service = running.child("service", other_than=service)
            psutil.Process(service).send_signal(signal.SIGKILL)
        running.first(r"(it is started again in 2 s)")


def test_a_setting_that_is_wrong_is_not_tried_again(tmp_path: Path) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        up(tmp_path, port=taken.getsockname()[1]) as running,
    ):
        assert running.process.wait(PATIENCE_S) == 1
    assert "the service did not start (status 1)" in running.said
    assert running.said.count("ddress already in use") == 1


class Clock:
    """Tell the time that the test sets."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        """Return the time."""
        return self.now


def _dies(kept: Supervisor, clock: Clock, said: list[str]) -> bool:
    """Return whether the supervisor goes on after the next end of its process, which it starts again then."""
    before, until = len(said), time.monotonic() + PATIENCE_S
    while len(said) == before:
        assert time.monotonic() < until
        if not kept.look():
            return False
        time.sleep(0.01)
    clock.now += 8.0  # longer than it waits for any new start
    return kept.look()


ENDING = {"it": ["-c", "import sys; sys.exit(3)"]}


@pytest.mark.parametrize(("apart_s", "goes_on"), [(22.0, False), (22.1, True)])
def test_so_many_deaths_within_that_time_and_no_more(apart_s: float, goes_on: bool) -> None:  # noqa: FBT001
    clock, said = Clock(), list[str]()
    kept = Supervisor(ENDING, tell=said.append, clock=clock)
    clock.now += supervision.SETTLED_S
    try:
        for _ in range(supervision.DEATHS - 1):
            assert _dies(kept, clock, said), said
            clock.now += apart_s
        assert _dies(kept, clock, said) == goes_on
    finally:
        kept.stop()
    assert said[-1].endswith("given up") != goes_on


@pytest.mark.parametrize(("age_s", "goes_on"), [(-0.01, False), (0.0, True)])
def test_who_refuses_at_first_is_not_started_again(age_s: float, goes_on: bool) -> None:  # noqa: FBT001
    clock, said = Clock(), list[str]()
    kept = Supervisor(ENDING, tell=said.append, clock=clock)
    clock.now += supervision.SETTLED_S + age_s
    try:
        assert _dies(kept, clock, said) == goes_on
    finally:
        kept.stop()


def test_waits_grow() -> None:
    clock, said = Clock(), list[str]()
    kept = Supervisor({"it": ["-c", "import os; os.kill(os.getpid(), 9)"]}, tell=said.append, clock=clock)
    try:
        while _dies(kept, clock, said):
            pass
    finally:
        kept.stop()
    waits = [float(wait) for line in said for wait in re.findall(r"in (\S+) s$", line)]
    assert waits == [0.5, 1.0, 2.0, 4.0]
    assert how_ended(-45) == "killed by signal 45"
