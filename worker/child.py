"""The warm child: it does its imports once, stands ready, and forks a process of its own for every job.

The fork starts in milliseconds, has all that the job needs loaded, and takes its memory, its limits and
its faults with it when it ends; the warm child itself never runs a job.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import json
import os
import re
import secrets
import signal
import sys
import tempfile
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import structlog

from service import crash_points, logs
from service.db.jobs import Attempt, LeaseLost
from service.db.session import Database, open_engine
from service.domain.bounds import Bounds
from service.domain.errors import DomainError, ReadingTooCostly, StorageFull, Unavailable
from service.domain.job_limits import JobLimits
from service.domain.lifecycle import JobKind
from service.settings import Settings
from service.storage.local import LocalBlobStore
from service.storage.room import Room, found_full, tells_full_disk
from service.usecases.bytes_first import bytes_first
from service.usecases.kernel import Kernel
from worker.context import JobContext, Messages, limit_process
from worker.registry import HANDLERS, after_fork, prepare

_PR_SET_PDEATHSIG = 1
_NO_MEMORY = re.compile(r"insufficient memory|bad_?alloc|failed to allocate|out of memory", re.IGNORECASE)

log = structlog.get_logger(__name__)


def main(parent: int) -> int:
    """Stand ready for the process `parent`, fork for each job that it sends, end with it."""
    _die_with(parent)
    messages = Messages(_take_stdout())
    settings = Settings()
    logs.configure(level=settings.log_level)
    crash_points.arm_from(settings.crash_at, folder=settings.data_dir)
    kernel = _kernel(settings)
    prepare()
    gc.freeze()
    messages.send("ready")
    while line := sys.stdin.buffer.readline():
        stem = os.getpid()
        pid = os.fork()
        if pid == 0:
            _run(json.loads(line), stem=stem, settings=settings, kernel=kernel, messages=messages)
        messages.send("started", pid=pid)
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        with suppress(ProcessLookupError, PermissionError):  # what it has started and left behind
            os.killpg(pid, signal.SIGKILL)
        _, status, used = os.wait4(pid, 0)
        took = {"peak_bytes": used.ru_maxrss * 1024, "cpu_s": used.ru_utime + used.ru_stime}
        messages.send("ended", code=os.waitstatus_to_exitcode(status), **took)
    return 0


def _run(job: dict[str, Any], *, stem: int, settings: Settings, kernel: Kernel, messages: Messages) -> None:
    """Do one job in the forked process, say how it went, and exit."""
    os.setpgid(0, 0)
    _die_with(stem)
    after_fork()
    os.environ["TMPDIR"] = tempfile.tempdir = job["workdir"]  # what the job leaves behind goes with it
    may = JobLimits(**job["limits"])
    limit_process(memory_bytes=may.memory_bytes, cpu_s=may.cpu_s)
    attempt = Attempt(**{**job["attempt"], "kind": JobKind(job["attempt"]["kind"])})
    bounds = Bounds(max_pixels=settings.max_pixels, max_points=settings.max_points)
    context = JobContext(kernel, attempt, Path(job["workdir"]), bounds, messages, may, settings.networks())
    failure = _attempt(context)
    kernel.db.close()
    if failure is None:
        messages.send("done")
    else:
        messages.send("failed", **failure)
    sys.stderr.flush()
    os._exit(0)


def _attempt(context: JobContext) -> dict[str, Any] | None:
    """Return how the attempt failed, as the members of its message, or None when its result is recorded."""
    bound = log.bind(job=context.attempt.job_id, kind=str(context.attempt.kind))
    try:
        with bytes_first(context.kernel):
            HANDLERS[context.attempt.kind](context)
    except LeaseLost:
        bound.warning("the job was taken over by another attempt; this result is dropped")
        return {"why": "lease-lost"}
    except Exception as error:  # noqa: BLE001 - here every failure becomes one of the job
        return _failure(context, error)
    return None


def _failure(context: JobContext, error: Exception) -> dict[str, Any]:
    """Return how the attempt failed by an error; what fails for want of room says so seldom by itself.

    What needs too much memory is told by the parent, which knows what was used; `ReadingTooCostly` is how a
    process tells it that the job has started.
    """
    bound = log.bind(job=context.attempt.job_id, kind=str(context.attempt.kind))
    if tells_full_disk(error) or context.kernel.room.is_used_up():
        bound.warning("the job found the disk full", cause=repr(error))
        full = error if isinstance(error, StorageFull) else found_full()
        return {"why": "full", "problem": full.problem()}
    if isinstance(error, Unavailable):
        return {"why": "unavailable", "problem": error.problem()}
    if isinstance(error, DomainError) and not isinstance(error, ReadingTooCostly):
        return {"why": "refused", "problem": context.problem(error)}
    if isinstance(error, MemoryError | ReadingTooCostly) or _NO_MEMORY.search(str(error)):
        return {"why": "memory"}
    bound.exception("a defect ended the job", exc_info=error)
    return {"why": "defect", "last": f"a defect ({type(error).__name__})"}


def _parent() -> int:
    """Return the process that started this one, as its argument says."""
    parser = argparse.ArgumentParser(prog="python -m worker.child", description="The worker starts this.")
    parser.add_argument("parent", type=int, help="the worker's process id: when it ends, so does this")
    found: int = parser.parse_args().parent
    return found


def _die_with(parent: int) -> None:
    """Let the kernel kill this process when its parent dies; exit at once if that has happened already."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent:
        os._exit(0)


def _take_stdout() -> int:
    """Return a private copy of standard output; what a library prints goes to standard error from now on."""
    fd = os.dup(1)
    os.dup2(2, 1)
    return fd


def _kernel(settings: Settings) -> Kernel:
    """Return the kernel, proven to reach its database; no connection is left for a fork to share."""
    database = Database(open_engine(settings.url()))
    database.prove()
    database.close()
    return Kernel(
        db=database,
        blobs=LocalBlobStore(settings.data_dir),
        now=lambda: datetime.now(UTC),
        entropy=secrets.token_bytes,
        room=Room(settings.folders(), reserve_bytes=settings.reserve_bytes),
    )


if __name__ == "__main__":
    sys.exit(main(_parent()))
