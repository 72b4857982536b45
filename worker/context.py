"""What a job's handler sees of the world, and what its process tells the parent."""

from __future__ import annotations

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from service import crash_points
from service.db.jobs import Attempt
from service.domain.bounds import Bounds
from service.usecases.kernel import Kernel

_BETWEEN_PROGRESS_S = 0.1


class Messages:
    """Send messages to the parent: one JSON object a line, whole or not at all.

    Parameters
    ----------
    fd : int
        Where they go: a pipe that the parent reads.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def send(self, kind: str, **members: Any) -> None:
        """Send one message; `kind` is one of `crash_points.MESSAGES`."""
        line = json.dumps({"message": kind, **members}).encode() + b"\n"
        crash_points.reach(f"message-{kind}.before-send")
        while line:
            line = line[os.write(self._fd, line) :]
        crash_points.reach(f"message-{kind}.after-send")


@dataclass
class JobContext:
    """Hold one attempt's job, the kernel it works with, and a private folder that vanishes with it."""

    kernel: Kernel
    attempt: Attempt
    workdir: Path
    bounds: Bounds
    messages: Messages
    _told_at: float = float("-inf")
    _told_stage: str = ""

    def progress(self, stage: str, fraction: float) -> None:
        """Tell the parent how far the work is: the stage, and the share of the whole job, 0 to 1.

        Messages of one stage closer than 0.1 s are left out.
        """
        now = time.monotonic()
        if stage == self._told_stage and now - self._told_at < _BETWEEN_PROGRESS_S:
            return
        self._told_at, self._told_stage = now, stage
        self.messages.send("progress", stage=stage, fraction=round(min(max(fraction, 0.0), 1.0), 4))

    def folder(self, name: str) -> Path:
        """Return a new empty folder within the private one."""
        path = self.workdir / name
        path.mkdir()
        return path
