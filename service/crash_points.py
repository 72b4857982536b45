"""Named instants at which a test may kill the process, to prove that nothing is lost or done twice.

Every commit, rename, fsync and message of a child passes one of these names. Nothing happens there
unless a composition root armed a point from its settings.
"""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass

CRASH_POINTS: frozenset[str] = frozenset(
    {
        "blob.before-fsync",
        "blob.before-rename",
        "blob.after-rename",
        "receive-drawing.before-commit",
        "receive-drawing.after-commit",
        "receive-scan.before-commit",
        "receive-scan.after-commit",
        "reread-drawing.before-commit",
        "reread-drawing.after-commit",
        "create-upload.before-commit",
        "create-upload.after-commit",
        "finish-upload.before-commit",
        "finish-upload.after-commit",
        "terminate-upload.before-commit",
        "terminate-upload.after-commit",
        "upload.before-fsync",
        "upload.after-fsync",
    }
)
"""Every name that `reach` is called with; a test compares it with the sources."""


@dataclass
class _Armed:
    name: str | None = None
    hits_left: int = 1


_armed = _Armed()


def arm(name: str, *, on_hit: int = 1) -> None:
    """Kill this process (SIGKILL) when the point `name` is reached for the `on_hit`-th time.

    Raises
    ------
    ValueError
        If no such point is listed.
    """
    if name not in CRASH_POINTS:
        msg = f"no crash point is called {name!r}"
        raise ValueError(msg)
    _armed.name, _armed.hits_left = name, on_hit


def reach(name: str) -> None:
    """Pass the instant `name`: die here if it is armed, else do nothing."""
    if _armed.name == name:
        _armed.hits_left -= 1
        if _armed.hits_left <= 0:
            os.kill(os.getpid(), signal.SIGKILL)
