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
from service.domain.errors import DomainError, JobOutOfMemory, JobTimedOut, ReaderCrashed
from service.domain.reading_cost import JobLimits, ReadingLimits

_READ_BYTES = 65536
_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_FAULTS = {
    signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL, signal.SIGTRAP, signal.SIGSYS
}  # fmt: skip
_END_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class Usage:
    """Hold what a job's processes take together: their memory, and their CPU seconds so far.

    Memory is what belongs to them alone, not the files that they have mapped; `own_bytes` is without what
    the warm child stands ready with.
    """

    memory_bytes: int = 0
    own_bytes: int = 0
    cpu_s: float = 0.0


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
    peak_bytes : int
        The most memory that the last job, or one process that it started, held at a time.
    cpu_s : float
        CPU seconds of the last job and of all that it has started, once it has ended.
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
        self.peak_bytes, self.cpu_s = 0, 0.0
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
        self.peak_bytes, self.cpu_s = 0, 0.0
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

    def usage(self) -> Usage:
        """Return what the job and all that it has started take; nothing when it is gone."""
        if self._job_pid is None:
            return Usage()
        seen = [_used(pid) for pid in _with_descendants(self._job_pid)]
        memory = sum(used.memory_bytes for used in seen)
        ready = _used(self._process.pid).memory_bytes
        return Usage(memory, max(0, memory - ready), sum(used.cpu_s for used in seen))

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
                self.peak_bytes, self.cpu_s = message["peak_bytes"], message["cpu_s"]
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


def _used(pid: int) -> Usage:
    """Return what one process takes, with the CPU of its children that have ended (proc(5))."""
    try:
        stat = (
            Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        )
        pages = Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
        memory = (int(pages[1]) - int(pages[2])) * _PAGE_BYTES
        return Usage(memory, memory, sum(map(int, stat[11:15])) / _TICKS_PER_S)
    except (OSError, IndexError):
        return Usage()


def over_limits(child: WarmChild, reading: ReadingLimits | None, limits: JobLimits) -> DomainError | None:
    """Return the refusal of a job whose processes take more than they may; None while they do not."""
    used = child.usage()
    if reading is not None:
        if used.own_bytes > reading.memory_bytes:
            return reading.refusal("memory")
        return reading.refusal("cpu") if used.cpu_s > reading.cpu_s else None
    if used.memory_bytes > limits.memory_bytes:
        return _out_of_memory(limits)
    return timed_out("CPU seconds", limits.cpu_s) if used.cpu_s > limits.cpu_s else None


def why_it_died(child: WarmChild, reading: ReadingLimits | None, limits: JobLimits) -> DomainError | None:
    """Return the refusal of a job that its own file or limits ended; None where another try may help."""
    fault = child.fault
    if child.ran_out_of_cpu:
        return timed_out("CPU seconds", limits.cpu_s) if reading is None else reading.refusal("cpu")
    if reading is None:
        return None
    if child.peak_bytes > reading.memory_bytes:
        return reading.refusal("memory")
    if fault is None:
        return None
    return ReaderCrashed(
        f"The reader crashed on {reading.file_name} ({fault.name}): it is damaged. Open it in the program "
        "that made it, repair it, and export it again.",
        signal=fault.name,
    )


def _out_of_memory(limits: JobLimits) -> JobOutOfMemory:
    limit = limits.memory_bytes // (1024 * 1024)
    return JobOutOfMemory(f"The job needed more than the {limit} MiB that a job may take.")


def timed_out(unit: str, limit: float) -> JobTimedOut:
    """Return the refusal of a job that took more than `limit` of a unit."""
    return JobTimedOut(f"The job took more than the {limit:g} {unit} that a job may take.")
