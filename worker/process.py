"""The warm child as its parent sees it: started once, handed one job at a time, listened to, killed."""

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
_END_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class Limits:
    """Hold what one job may take: memory, CPU seconds, and seconds of wall clock."""

    memory_bytes: int
    cpu_s: float
    wall_s: float


class WarmChild:
    """Run ``python -m worker.child``, which forks for each job; all die when the thread that made it ends.

    Attributes
    ----------
    is_ready : bool
        Whether its imports are done.
    is_working : bool
        Whether it has a job that has not ended.
    has_ended : bool
        Whether it is gone, and its job with it.
    """

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
        self._job_pid: int | None = None
        self._job_code: int | None = None
        self._is_closed = False
        self.has_ended = False
        self.is_ready = False
        self.is_working = False

    def wait_ready(self, *, timeout_s: float) -> bool:
        """Return whether the child has done its imports, waiting for it up to `timeout_s`."""
        until = time.monotonic() + timeout_s
        self.listen(timeout_s=0.0)
        while not self.is_ready and not self.has_ended and (left := until - time.monotonic()) > 0:
            self.listen(timeout_s=left)
        return self.is_ready and not self.has_ended

    def hand_over(self, attempt: Attempt, *, workdir: Path, limits: Limits) -> None:
        """Give the child a job; it has none. A child that is dead by now says so by its end."""
        job = {
            "attempt": asdict(attempt),
            "workdir": str(workdir),
            "memory_bytes": limits.memory_bytes,
            "cpu_s": limits.cpu_s,
        }
        self.is_working, self._job_pid, self._job_code = True, None, None
        crash_points.reach("message-job.before-send")
        with suppress(BrokenPipeError):
            self._stdin.write(json.dumps(job).encode() + b"\n")
            self._stdin.flush()
        crash_points.reach("message-job.after-send")

    def listen(self, *, timeout_s: float) -> list[dict[str, Any]]:
        """Return what the job said, waiting up to `timeout_s`; `is_working` and `has_ended` follow."""
        if self.has_ended or not self._selector.select(timeout_s):
            return []
        with suppress(BlockingIOError):
            chunk = os.read(self._stdout.fileno(), _READ_BYTES)
            if not chunk:
                self._process.wait()
                self.has_ended, self.is_working = True, False
            self._rest += chunk
        *lines, self._rest = self._rest.split(b"\n")
        return [m for m in map(json.loads, lines) if not self._is_own(m)]

    def memory_bytes(self) -> int:
        """Return the job's resident memory; 0 when it is gone."""
        try:
            statm = Path(f"/proc/{self._job_pid}/statm").read_text(encoding="ascii")
            return int(statm.split()[1]) * _PAGE_BYTES
        except (OSError, IndexError):
            return 0

    def end_job(self) -> list[dict[str, Any]]:
        """Kill the job, and return what it had said until it was gone; the child stands ready again."""
        said: list[dict[str, Any]] = []
        until = time.monotonic() + _END_TIMEOUT_S
        while self.is_working and time.monotonic() < until:
            if self._job_pid is not None:
                with suppress(ProcessLookupError):
                    os.kill(self._job_pid, signal.SIGKILL)
            said += self.listen(timeout_s=0.1)
        if self.is_working:
            self.end()
        return said

    def end(self) -> None:
        """Kill the child and its job, and wait until it is gone."""
        if self._is_closed:
            return
        self._is_closed = True
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self.has_ended, self.is_working = True, False
        self._selector.close()
        with suppress(BrokenPipeError):
            self._stdin.close()
        self._stdout.close()

    def how_it_ended(self) -> str:
        """Return how the job ended, or else the child, for people: its signal or its status."""
        code = self._job_code if self._job_code is not None else self._process.wait()
        if code < 0:
            return f"killed by signal {-code} ({signal.Signals(-code).name})"
        return f"ended with status {code}"

    @property
    def ran_out_of_cpu(self) -> bool:
        """Return whether the job was stopped for using up its CPU seconds."""
        return self._job_code == -signal.SIGXCPU

    def _is_own(self, message: dict[str, Any]) -> bool:
        """Return whether a message is the warm child's own, and take note of what it says."""
        match message["message"]:
            case "ready":
                self.is_ready = True
            case "started":
                self._job_pid = message["pid"]
            case "ended":
                self._job_code, self.is_working = message["code"], False
            case _:
                return False
        return True
