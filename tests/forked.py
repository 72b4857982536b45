"""The product's processes as tests start them: forked from one that has done their imports.

`forked("service", "serve", env=...)` gives the same process as ``python -m service serve``, with the same
signals, files and environment, without the seconds of imports that each of some hundred starts would take.
What a start itself does is tested by real starts: `tests/service/test_process.py`, `tests/journeys`.
"""

from __future__ import annotations

import argparse
import atexit
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parent.parent
MODULES = {"service": "service.cli", "worker": "worker.__main__", "worker.vda5050": "worker.vda5050.__main__"}
"""The module that `python -m` runs, and what it imports; the module has a `main` without arguments."""
_MESSAGE_BYTES = 1 << 17
_POLL_S = 0.01


class Forked:
    """A process with the members of `subprocess.Popen` that tests use.

    Parameters
    ----------
    stem : Stem
        The process it was forked from.
    pid : int
        Its own.
    stdout : file, optional
        What it prints, where that was asked for.
    """

    def __init__(self, stem: Stem, pid: int, stdout: IO[str] | None) -> None:
        self.pid, self.stdout = pid, stdout
        self.returncode: int | None = None
        self._stem = stem

    def poll(self) -> int | None:
        """Return the exit status, or None while it runs."""
        if self.returncode is None:
            self.returncode = self._stem.status_of(self.pid)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit status, once it has ended.

        Raises
        ------
        subprocess.TimeoutExpired
            If that takes longer than `timeout` [s].
        """
        until = None if timeout is None else time.monotonic() + timeout
        while self.poll() is None:
            if until is not None and time.monotonic() > until:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
            time.sleep(_POLL_S)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, sig: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, sig)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)


class Stem:
    """A process that has imported a module, and forks at each word."""

    def __init__(self, module: str) -> None:
        self._here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.forked", module, str(there.fileno())],
                pass_fds=[there.fileno()],
                cwd=ROOT,
            )
        self._turn = threading.Lock()
        atexit.register(self.close)

    def fork(self, *words: str, env: Mapping[str, str], session: bool, fds: tuple[int, int]) -> int:
        """Return the id of a new process with these words, which writes to the descriptors `fds`."""
        pid = self._ask({"words": words, "env": dict(env), "session": session}, fds)
        assert pid is not None
        return pid

    def status_of(self, pid: int) -> int | None:
        """Return the exit status of a process that it has forked, None while that runs."""
        return self._ask({"pid": pid})

    def close(self) -> None:
        """End the stem; what was forked from it goes on."""
        self._here.close()
        self._process.wait()

    def _ask(self, order: Mapping[str, object], fds: tuple[int, ...] = ()) -> int | None:
        with self._turn:
            socket.send_fds(self._here, [json.dumps(order).encode()], fds)
            answer = self._here.recv(_MESSAGE_BYTES)
        assert answer, "the process that others are forked from has ended"
        told: int | None = json.loads(answer)
        return told


@cache
def _stem(module: str) -> Stem:
    return Stem(module)


def forked(
    module: str, *words: str, env: Mapping[str, str], stdout: IO[bytes] | IO[str] | int | None = None,
    stderr: IO[bytes] | IO[str] | None = None, start_new_session: bool = False,
) -> Forked:  # fmt: skip
    """Return a process as ``python -m module words`` would be one; `stdout` may be `subprocess.PIPE`."""
    ours, theirs = os.pipe() if stdout == subprocess.PIPE else (None, None)
    if theirs is None:
        theirs = os.dup(1 if stdout is None else stdout.fileno())  # type: ignore[union-attr]  # no other number
    errors = 2 if stderr is None else stderr.fileno()
    stem = _stem(module)
    try:
        pid = stem.fork(*words, env=env, session=start_new_session, fds=(theirs, errors))
    finally:
        os.close(theirs)
    return Forked(stem, pid, None if ours is None else os.fdopen(ours, encoding="utf-8"))


def _serve(module: str, line: socket.socket) -> list[str] | None:
    """Fork at each word; return the words of a process in it, and None in the stem at the end."""
    ended: dict[int, int] = {}
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    while True:
        message, fds, _, _ = socket.recv_fds(line, _MESSAGE_BYTES, 2)
        if not message:
            return None
        order = json.loads(message)
        if "pid" in order:
            if order["pid"] not in ended:
                pid, status = os.waitpid(order["pid"], os.WNOHANG)
                if pid:
                    ended[pid] = os.waitstatus_to_exitcode(status)
            line.send(json.dumps(ended.get(order["pid"])).encode())
            continue
        pid = os.fork()
        ended.pop(pid, None)
        if pid == 0:
            line.close()
            _become(order, fds)
            return [module, *order["words"]]
        line.send(json.dumps(pid).encode())
        for fd in fds:
            os.close(fd)


def _become(order: dict[str, object], fds: list[int]) -> None:
    """Take what a new process is given: its streams, session and environment."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for fd, at in zip(fds, (1, 2), strict=True):
        os.dup2(fd, at)
        os.close(fd)
    if order["session"]:
        os.setsid()
    os.environ.clear()
    os.environ.update(order["env"])  # type: ignore[arg-type]  # as it was sent


def _main() -> int:
    parser = argparse.ArgumentParser(
        description="Import a module's program, and fork at each word; for tests."
    )
    parser.add_argument("module", choices=MODULES)
    parser.add_argument("fd", type=int, help="the socket over which the words come")
    asked = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a person who stops the tests stops what they started
    import_module(MODULES[asked.module])
    words = _serve(asked.module, socket.socket(fileno=asked.fd))
    if words is None:
        return 0
    sys.argv = words
    status: int = import_module(f"{asked.module}.__main__").main()
    return status


if __name__ == "__main__":
    sys.exit(_main())
