"""A fleet's convergence as it is shown."""

from __future__ import annotations

from typing import Self

from pydantic import Field

from service.api.schemas.base import Output
from service.usecases.convergence import Convergence
from service.usecases.robots import Progress, progress_of


class PointedOut(Output):
    """Where a channel of a map points."""

    map_id: str
    channel: str = Field(validation_alias="name")
    revision: int = Field(validation_alias="revision_n")


class CountedRobotsOut(Output):
    """How many robots of a channel should run the same revision, run the same, and have come as far."""

    map_id: str
    channel: str
    wanted_revision: int | None
    enabled_revision: int | None
    progress: Progress
    robots: int


class ConvergenceOut(Output):
    """Where the channels point, and what the robots run."""

    channels: list[PointedOut]
    robots: list[CountedRobotsOut]

    @classmethod
    def of(cls, found: Convergence) -> Self:
        """Return a fleet's convergence as JSON; groups that differ in their last report alone are one."""
        counts: dict[tuple[str, str, int | None, int | None, Progress], int] = {}
        for one in found.robots:
            key = (one.map_id, one.channel, one.wanted_n, one.enabled_n, progress_of(one, one.wanted_n))
            counts[key] = counts.get(key, 0) + one.robots
        return cls(
            channels=[PointedOut.model_validate(row) for row in found.channels],
            robots=[
                CountedRobotsOut(
                    map_id=map_id,
                    channel=channel,
                    wanted_revision=wanted,
                    enabled_revision=enabled,
                    progress=progress,
                    robots=number,
                )
                for (map_id, channel, wanted, enabled, progress), number in counts.items()
            ],
        )
