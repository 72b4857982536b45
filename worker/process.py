"""A child process as its parent sees it: started ahead, handed one job, listened to, measured, killed."""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from service import crash_points
from service.db.jobs import Attempt

_READ_BYTES = 65536
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Limits:
    """Hold what one job may take: memory, CPU seconds, and seconds of wall clock."""

    memory_bytes: int
    cpu_s: float
    wall_s: float


class Child:
    """Run ``python -m worker.child`` in a session of its own; it dies when the thread that made it ends."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "worker.child", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout
        os.set_blocking(self._stdout.fileno(), False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._stdout, selectors.EVENT_READ)
        self._rest = b""
        self.has_ended = False
        self.is_ready = False
        self._is_closed = False

    @property
    def pid(self) -> int:
        """Return the process id."""
        return self._process.pid

    def wait_ready(self, *, timeout_s: float) -> bool:
        """Return whether the child has done its imports, waiting for it up to `timeout_s`."""
        until = time.monotonic() + timeout_s
        while not self.is_ready and not self.has_ended and (left := until - time.monotonic()) > 0:
            self.is_ready = any(m["message"] == "ready" for m in self.messages(timeout_s=left))
        return self.is_ready

    def hand_over(self, attempt: Attempt, *, workdir: Path, limits: Limits) -> None:
        """Give the child its one job. A child that is dead by now says so by ending."""
        job = {
            "attempt": asdict(attempt),
            "workdir": str(workdir),
            "memory_bytes": limits.memory_bytes,
            "cpu_s": limits.cpu_s,
        }
        crash_points.reach("message-job.before-send")
        with suppress(BrokenPipeError):
            self._stdin.write(json.dumps(job).encode() + b"\n")
            self._stdin.flush()
        crash_points.reach("message-job.after-send")

    def messages(self, *, timeout_s: float) -> list[dict[str, Any]]:
        """Return what the child said, waiting up to `timeout_s`; `has_ended` tells when it says no more."""
        if self.has_ended or not self._selector.select(timeout_s):
            return []
        with suppress(BlockingIOError):
            chunk = os.read(self._stdout.fileno(), _READ_BYTES)
            if not chunk:
                self._process.wait()
                self.has_ended = True
            self._rest += chunk
        *lines, self._rest = self._rest.split(b"\n")
        return [json.loads(line) for line in lines]

    def memory_bytes(self) -> int:
        """Return the child's resident memory; 0 when it is gone."""
        try:
            return int(Path(f"/proc/{self.pid}/statm").read_text(encoding="ascii").split()[1]) * _PAGE_BYTES
        except (OSError, IndexError):
            return 0

    def end(self) -> None:
        """Kill the child and all that it started, and wait until it is gone."""
        if self._is_closed:
            return
        self._is_closed = True
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.pid, signal.SIGKILL)
        self._process.kill()
        self._process.wait()
        self.has_ended = True
        self._selector.close()
        with suppress(BrokenPipeError):
            self._stdin.close()
        self._stdout.close()

    def how_it_ended(self) -> str:
        """Return how the child ended, for people: its signal or its status."""
        code = self._process.wait()
        if code < 0:
            return f"killed by signal {-code} ({signal.Signals(-code).name})"
        return f"ended with status {code}"

    @property
    def ran_out_of_cpu(self) -> bool:
        """Return whether the child was stopped for using up its CPU seconds."""
        return self._process.poll() == -signal.SIGXCPU
