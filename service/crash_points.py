"""Named instants at which a test may kill or halt the process, to prove that nothing is lost or done twice.

Every commit, rename, fsync and message between a worker and its child passes one of these names.
Nothing happens there unless a composition root armed a point from its settings.
"""

from __future__ import annotations

import os
import signal
from dataclasses import dataclass
from pathlib import Path

TRANSACTIONS: frozenset[str] = frozenset(
    {
        # service
        "create-first-key",
        "create-key",
        "revoke-key",
        "create-map",
        "change-map",
        "revise",
        "place-scan",
        "accept-placement",
        "publish",
        "ask-delta",
        "ask-export",
        "ask-comparison",
        "rebuild-revision",
        "decide-proposal",
        "enrol-robot",
        "change-robot",
        "take-report",
        "begin-rollout",
        "change-rollout",
        "advance-rollout",
        "make-webhook",
        "renew-webhook-secret",
        "remove-webhook",
        "dispatch-webhooks",
        "cancel-job",
        "retry-job",
        "forget-answers",
        "receive-drawing",
        "receive-scan",
        "reread-drawing",
        "create-upload",
        "finish-upload",
        "terminate-upload",
        "sweep-uploads",
        "prune-revisions",
        # worker
        "claim-job",
        "beat-job",
        "end-job",
        "tell-waiting-jobs",
        "redeliver-jobs",
        "record-drawing-reading",
        "record-scan-reading",
        "record-placement",
        "record-revision",
        "record-delta",
        "record-comparison",
        "record-rebuild",
        "record-deliveries",
        "record-export",
        # bridge to vehicles
        "hold-bridge-lease",
        "end-bridge-lease",
        "remark-on-robot",
    }
)
"""Every name that `Database.writing` is called with; each has the points before-commit and after-commit."""

MESSAGES: frozenset[str] = frozenset({"job", "ready", "started", "progress", "done", "failed", "ended"})
"""Every message between a worker and its child; each has the points before-send and after-send."""

CRASH_POINTS: frozenset[str] = (
    frozenset(
        {
            "blob.before-fsync",
            "blob.before-rename",
            "blob.after-rename",
            "upload.before-fsync",
            "upload.after-fsync",
        }
    )
    | {f"{name}.{when}" for name in TRANSACTIONS for when in ("before-commit", "after-commit")}
    | {f"message-{kind}.{when}" for kind in MESSAGES for when in ("before-send", "after-send")}
)
"""Every name that `reach` is called with; a test compares it with the sources."""


@dataclass
class _Armed:
    name: str | None = None
    hits_left: int = 1
    order: Path | None = None


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
    _armed.name, _armed.hits_left, _armed.order = name, on_hit, None


def obey(order: Path) -> None:
    """Kill this process when it reaches the point that the file `order` names at that time.

    The file is removed before the kill: one order kills one process, whichever comes first. Where the name is
    followed by ` halt`, the process is stopped instead (SIGSTOP), until somebody lets it go on.
    """
    _armed.name, _armed.order = None, order


def arm_from(setting: str | None, *, folder: Path) -> None:
    """Arm what a setting names: ``name``, ``name:n``, or ``@file`` for a file of orders in `folder`.

    Raises
    ------
    ValueError
        If the setting has another form, or no such point is listed.
    """
    if setting is None:
        return
    if setting.startswith("@"):
        obey(folder.absolute() / setting[1:])
        return
    name, _, hit = setting.partition(":")
    arm(name, on_hit=int(hit or 1))


def reach(name: str) -> None:
    """Pass the instant `name`: die here if it is armed, else do nothing."""
    if _armed.order is not None:
        _follow(_armed.order, name)
    elif _armed.name == name:
        _armed.hits_left -= 1
        if _armed.hits_left <= 0:
            os.kill(os.getpid(), signal.SIGKILL)


def _follow(order: Path, name: str) -> None:
    try:
        wanted, _, halt = order.read_text(encoding="ascii").partition(" ")
        if wanted != name:
            return
        order.unlink()
    except FileNotFoundError:
        return
    os.kill(os.getpid(), signal.SIGSTOP if halt else signal.SIGKILL)
