"""What a job may take, in all its processes together, and what is said of one that takes more."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from service.domain.errors import DomainError, JobOutOfMemory, JobTimedOut

Limit = Literal["cpu", "memory", "wall"]

JOB_MEMORY_BYTES = 10 << 30
"""Most that a job may take unless an operator says otherwise [bytes]: the largest scan takes 7 GiB."""

JOB_MEMORY_SHARE = 0.8
"""Share of a small machine's or container's memory in its place: the rest is the worker's and others'."""


def job_memory_of(total_bytes: int) -> int:
    """Return how much memory a job may take where there is so much: 10 GiB or 80 %, the lesser.

    Examples
    --------
    >>> job_memory_of(10 << 30) == 8 << 30
    True
    >>> job_memory_of(64 << 30) == 10 << 30
    True
    """
    return min(JOB_MEMORY_BYTES, int(total_bytes * JOB_MEMORY_SHARE))


@dataclass(frozen=True)
class Usage:
    """Hold what a job's processes took together: memory beyond what a worker stands ready with, and time."""

    memory_bytes: int = 0
    cpu_s: float = 0.0
    wall_s: float = 0.0

    def most(self, other: Usage) -> Usage:
        """Return the larger of each."""
        return Usage(
            max(self.memory_bytes, other.memory_bytes),
            max(self.cpu_s, other.cpu_s),
            max(self.wall_s, other.wall_s),
        )


@dataclass(frozen=True)
class Limits:
    """Hold the most that is taken."""

    memory_bytes: int
    cpu_s: float
    wall_s: float

    def passed(self, used: Usage) -> Limit | None:
        """Return which limit a usage has passed, if any."""
        if used.memory_bytes > self.memory_bytes:
            return "memory"
        if used.cpu_s > self.cpu_s:
            return "cpu"
        return "wall" if used.wall_s > self.wall_s else None

    def refusal(self, limit: Limit, used: Usage) -> DomainError:
        """Return the refusal of a job that was stopped at a limit."""
        leaf = JobOutOfMemory if limit == "memory" else JobTimedOut
        return leaf(
            f"The job {self.took(limit, used)}; a job may take {self.most(limit)}. Ask for less at a time: a "
            "larger voxel size, fewer or thinner layers, a smaller part of the site. Or let the operator "
            f"raise {_SETTING[limit]}.",
            **self.members(limit, used),
        )

    def took(self, limit: Limit, used: Usage) -> str:
        """Return for people what was used."""
        if limit == "memory":
            return f"held {used.memory_bytes >> 20} MiB of memory and wanted more"
        return f"took {used.cpu_s:.4g} s of CPU" if limit == "cpu" else f"took {used.wall_s:.4g} s"

    def most(self, limit: Limit) -> str:
        """Return a limit for people."""
        if limit == "memory":
            return f"{self.memory_bytes >> 20} MiB"
        return f"{self.cpu_s:.4g} s" if limit == "cpu" else f"{self.wall_s:.4g} s"

    def members(self, limit: Limit, used: Usage) -> dict[str, Any]:
        """Return for machines which limit it was, what may be used, and what was."""
        return {
            "limit": limit,
            "memory_limit_bytes": self.memory_bytes,
            "memory_used_bytes": used.memory_bytes,
            "cpu_limit_s": round(self.cpu_s, 1),
            "cpu_used_s": round(used.cpu_s, 1),
            "wall_limit_s": round(self.wall_s, 1),
            "wall_used_s": round(used.wall_s, 1),
        }


@dataclass(frozen=True)
class JobLimits(Limits):
    """Hold what one job may take, and what reading a file may that promises little."""

    reading_memory_bytes: int
    reading_cpu_s: float


_SETTING = {
    "memory": "GROUNDPLAN_JOB_MEMORY_BYTES",
    "cpu": "GROUNDPLAN_JOB_CPU_S",
    "wall": "GROUNDPLAN_JOB_WALL_S",
}
