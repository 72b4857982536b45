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
from dataclasses import asdict
from pathlib import Path
from typing import Any

from service import crash_points
from service.db.jobs import Attempt
from service.domain.errors import DomainError
from service.domain.job_limits import JobLimits, Limits, Usage
from service.domain.reading_cost import ReadingLimits, reader_crashed

_READ_BYTES = 65536
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_FAULTS = {
    signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP, signal.SIGSYS
}  # fmt: skip
_END_TIMEOUT_S = 10.0


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
    used : Usage
        The most that the last job was seen to take.
    peak_bytes : int
        The most memory that it, or one process that it started, held at a time, mapped files included.
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
        self.used, self.peak_bytes = Usage(), 0
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

    def hand_over(self, attempt: Attempt, *, workdir: Path, limits: JobLimits) -> None:
        """Give the child a job; it has none. A child that is dead by now says so by its end."""
        job = {
            "attempt": asdict(attempt),
            "workdir": str(workdir),
            "limits": asdict(limits),
        }
        self.is_working, self._job_pid, self._job_code = True, None, None
        self.used, self.peak_bytes = Usage(), 0
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

    def look(self) -> Usage:
        """Return what the job and all that it has started take now; nothing when it is gone."""
        if self._job_pid is None:
            return Usage()
        seen = [_used(pid) for pid in _with_descendants(self._job_pid)]
        memory = sum(used.memory_bytes for used in seen) - _used(self._process.pid).memory_bytes
        now = Usage(max(0, memory), sum(used.cpu_s for used in seen))
        self.used = self.used.most(now)
        return now

    def end_job(self) -> list[dict[str, Any]]:
        """Kill the job, and return what it had said until it was gone; the child stands ready again."""
        said: list[dict[str, Any]] = []
        until = time.monotonic() + _END_TIMEOUT_S
        while self.is_working and time.monotonic() < until:
            self._kill_job()
            said += self.listen(timeout_s=0.1)
        if self.is_working:
            self.end()
        return said

    def end(self) -> None:
        """Kill the child and its job, and wait until it is gone."""
        if self._is_closed:
            return
        self._is_closed = True
        if self.is_working:
            self._kill_job()
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
    def fault(self) -> signal.Signals | None:
        """Return the signal by which the job ended for a fault of its own; None where it was killed."""
        code = self._job_code or 0
        return signal.Signals(-code) if -code in _FAULTS else None

    @property
    def ran_out_of_cpu(self) -> bool:
        """Return whether the job was stopped for using up its CPU seconds."""
        return self._job_code == -signal.SIGXCPU

    def _kill_job(self) -> None:
        """Kill the job and its process group; before it has made its group, it has started nothing."""
        if self._job_pid is None:
            return
        for kill in (os.killpg, os.kill):
            with suppress(ProcessLookupError, PermissionError):
                kill(self._job_pid, signal.SIGKILL)

    def _is_own(self, message: dict[str, Any]) -> bool:
        """Return whether a message is the warm child's own, and take note of what it says."""
        match message["message"]:
            case "ready":
                self.is_ready = True
            case "started":
                self._job_pid = message["pid"]
            case "ended":
                self._job_code, self.is_working = message["code"], False
                self.peak_bytes = message["peak_bytes"]
                own = self.peak_bytes - _resident_bytes(self._process.pid)
                self.used = self.used.most(Usage(own, message["cpu_s"]))
            case _:
                return False
        return True


def _with_descendants(pid: int) -> list[int]:
    """Return a process and all that it and its children have started and that live."""
    found, at = [pid], 0
    while at < len(found):
        for task in Path(f"/proc/{found[at]}/task").glob("*/children"):
            with suppress(OSError):
                found += [int(child) for child in task.read_text(encoding="ascii").split()]
        at += 1
    return found


def _resident_bytes(pid: int) -> int:
    """Return what a process holds, the files that it has mapped included; 0 when it is gone."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]) * _PAGE_BYTES
    except (OSError, IndexError):
        return 0


def _used(pid: int) -> Usage:
    """Return what one process takes, with the CPU of its children that have ended (proc(5)).

    Memory is what belongs to it alone, not the files that it has mapped.
    """
    try:
        stat = (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        )
        pages = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
        memory = (int(pages[1]) - int(pages[2])) * _PAGE_BYTES
        return Usage(memory, sum(map(int, stat[11:15])) / _TICKS_PER_S)
    except (OSError, IndexError):
        return Usage()


def why_it_died(child: WarmChild, limits: Limits, used: Usage) -> DomainError | None:
    """Return the refusal of a job that its own file or limits ended; None where another try may help."""
    if child.ran_out_of_cpu:
        return limits.refusal("cpu", used)
    if not isinstance(limits, ReadingLimits):
        return None
    if used.memory_bytes > limits.memory_bytes:
        return limits.refusal("memory", used)
    return None if child.fault is None else reader_crashed(limits.file_name, how=child.fault.name)
