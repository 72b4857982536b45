"""Processes that are started again when they end by themselves, until that is of no use."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

DEATHS = 5
"""After so many ends within `WITHIN_S` a process is given up: what the waits between them could mend is
mended by then (a database that starts, memory that others took)."""

WITHIN_S = 120.0
"""How long an end counts [s]: well above the 7.5 s of waits and five starts of some seconds."""

FIRST_WAIT_S = 0.5
"""How long the first new start waits [s]; each further one twice as long."""

SETTLED_S = 10.0
"""Who refuses (ends by a status of its own) sooner after the very first start never ran: a setting is wrong
or its port is taken, and nothing is tried again [s]. Service and worker start in about two seconds."""

_STOP_S = 20.0
_PR_SET_PDEATHSIG = 1


@dataclass
class _Kept:
    """Hold one process: how it is started, what runs of it, when it ended, when it is due again."""

    command: Sequence[str]
    process: subprocess.Popen[bytes]
    begun: float
    ends: deque[float] = field(default_factory=deque)
    due: float | None = None


class Supervisor:
    """Keep processes running.

    Parameters
    ----------
    commands : mapping of str to sequence of str
        What is started, by the names that people are told.
    tell : callable
        Told each end and each new start in one line.
    clock : callable
        Tells seconds that never go back.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        *,
        tell: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._tell = tell
        self._clock = clock
        self._kept = {name: _Kept(command, start(command), clock()) for name, command in commands.items()}

    def look(self) -> bool:
        """Start again what has ended and is due; return False when one has to be given up."""
        return all(self._look_after(name, kept) for name, kept in self._kept.items())

    def stop(self) -> None:
        """End all of them, the stubborn ones after 20 s by force."""
        processes = [kept.process for kept in self._kept.values()]
        for process in processes:
            if process.poll() is None:
                process.terminate()
        for process in processes:
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _look_after(self, name: str, kept: _Kept) -> bool:
        now, status = self._clock(), kept.process.poll()
        if kept.due is None:
            refused = status is not None and status > 0 and not kept.ends and now - kept.begun < SETTLED_S
            if refused:
                self._tell(f"the {name} did not start (status {status}): what it said has to be mended")
            return not refused and (status is None or self._goes_on(name, kept, how_ended(status), now=now))
        if now < kept.due:
            return True
        try:
            kept.process, kept.due = start(kept.command), None
        except OSError as error:
            return self._goes_on(name, kept, f"not started: {error.strerror}", now=now)
        return True

    def _goes_on(self, name: str, kept: _Kept, how: str, *, now: float) -> bool:
        """Return whether a process that has ended will be started again; it is due then."""
        kept.ends.append(now)
        while now - kept.ends[0] > WITHIN_S:
            kept.ends.popleft()
        count = len(kept.ends)
        if count >= DEATHS:
            self._tell(f"the {name} ended by itself ({how}), {count} times within {WITHIN_S:g} s: given up")
            return False
        wait_s = FIRST_WAIT_S * 2.0 ** (count - 1)
        self._tell(f"the {name} ended by itself ({how}); it is started again in {wait_s:g} s")
        kept.due = now + wait_s
        return True


def start(command: Sequence[str]) -> subprocess.Popen[bytes]:
    """Return ``python COMMAND`` in a session of its own, so that Ctrl-C reaches it through this process."""
    return subprocess.Popen(
        [sys.executable, *command],
        start_new_session=True,
        preexec_fn=_end_with_parent,  # noqa: PLW1509 - no thread runs here
    )


def _end_with_parent() -> None:
    """Let the kernel end the new process when this one is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def how_ended(status: int) -> str:
    """Return how a process ended, by its status as `subprocess` has it."""
    if status >= 0:
        return f"status {status}"
    named = (one.name for one in signal.Signals if one == -status)
    return f"killed by {next(named, f'signal {-status}')}"
