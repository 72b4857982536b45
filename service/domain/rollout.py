"""A staged roll-out: its states, its stages, and which robots a stage takes."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

_RANK_DIGITS = 16
EVERY_RANK = "f" * _RANK_DIGITS
"""The bound below which every robot's rank lies."""


class RolloutState(StrEnum):
    """Where a roll-out stands; ``finished`` and ``aborted`` are final.

    A ``paused`` one begins no further stage; a ``stopped`` one sends the revision to nobody else.
    """

    RUNNING = "running"
    PAUSED = "paused"
    STOPPED = "stopped"
    ABORTED = "aborted"
    FINISHED = "finished"

    @property
    def has_ended(self) -> bool:
        """Return whether the roll-out decides about no robot any more."""
        return self in {RolloutState.ABORTED, RolloutState.FINISHED}


class RolloutStepKind(StrEnum):
    """What happened to a roll-out."""

    STAGE = "stage"
    PAUSED = "paused"
    RESUMED = "resumed"
    STOPPED = "stopped"
    ABORTED = "aborted"
    FINISHED = "finished"


@dataclass(frozen=True)
class Stage:
    """Hold one stage: whom it takes beside those of earlier stages, and when the next one may begin.

    Parameters
    ----------
    group : str, optional
        Takes the robots of this group; else `share` is given.
    share : float, optional
        Takes robots until this share of the channel's robots is reached, 0 to 1.
    threshold : float
        Share of all robots taken so far that have to run the revision before the stage is over, 0 to 1.
    min_s : float
        Seconds that the stage lasts at least.
    """

    group: str | None
    share: float | None
    threshold: float = 1.0
    min_s: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return the stage as a JSON object."""
        return {
            "group": self.group,
            "share": self.share,
            "threshold": self.threshold,
            "min_s": self.min_s,
        }

    @classmethod
    def from_json(cls, kept: dict[str, Any]) -> Stage:
        """Return the stage that `to_json` gave."""
        return cls(**kept)

    def is_reached(self, *, enabled: int, taken: int) -> bool:
        """Return whether enough of the robots taken run the revision; of none, all do."""
        return enabled >= math.ceil(self.threshold * taken - 1e-9)


@dataclass(frozen=True)
class Plan:
    """Hold what a roll-out is to do.

    Parameters
    ----------
    revision_n : int
        What the robots get.
    stages : tuple of Stage
        In which steps.
    failure_limit : int
        It stops when so many robots have failed.
    override : str, optional
        Why it begins although gates are closed.
    """

    revision_n: int
    stages: tuple[Stage, ...]
    failure_limit: int = 1
    override: str | None = None


def rank(rollout_id: str, robot_id: str) -> str:
    """Return where a robot stands in a roll-out's order: 16 hex digits, evenly spread, another each time."""
    return hashlib.sha256(f"{rollout_id}/{robot_id}".encode()).hexdigest()[:_RANK_DIGITS]


def bound_of(rollout_id: str, robot_ids: Iterable[str], *, share: float) -> str:
    """Return the highest rank that a share takes: of N robots the first ``ceil(share N)``.

    Robots that are enrolled later belong to the share where their rank is not above it, and nobody leaves it
    for them.
    """
    if share >= 1.0:
        return EVERY_RANK
    ranks = sorted(rank(rollout_id, robot_id) for robot_id in robot_ids)
    count = math.ceil(share * len(ranks) - 1e-9)
    return ranks[count - 1] if count else ""


def takes(
    rollout_id: str, robot_id: str, *, group: str | None, begun: Sequence[Stage], bound: str | None
) -> bool:
    """Return whether the stages that have begun take a robot."""
    if group is not None and any(stage.group == group for stage in begun):
        return True
    return bound is not None and rank(rollout_id, robot_id) <= bound
