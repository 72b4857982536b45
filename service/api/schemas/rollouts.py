"""Roll-outs as JSON."""

from __future__ import annotations

from datetime import datetime
from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

from service.api.schemas.base import Input, Output, Text
from service.api.schemas.revisions import Channel
from service.api.schemas.robots import Group
from service.domain.rollout import Plan, RolloutState, RolloutStepKind, Stage
from service.usecases.rollouts import Shown

_Share = Annotated[float, Field(gt=0, le=1)]


class StageIn(Input):
    """One stage: a `group`, or a `share` of the channel's robots."""

    group: Group | None = Field(None, description="Takes the robots of this group.")
    share: _Share | None = Field(
        None,
        description="Takes robots until this share of all on the channel has the revision; which ones is"
        " decided by their ids and the roll-out's.",
    )
    threshold: _Share = Field(
        1.0,
        description="Share of all robots taken so far that have to report `enabled` before the next stage.",
    )
    min_s: float = Field(0.0, ge=0, le=30 * 86400, description="Seconds that the stage lasts at least.")

    @model_validator(mode="after")
    def _is_one(self) -> Self:
        if (self.group is None) == (self.share is None):
            msg = "a stage has either a group or a share"
            raise ValueError(msg)
        return self

    def stage(self) -> Stage:
        """Return the stage."""
        return Stage(self.group, self.share, self.threshold, self.min_s)


class RolloutIn(Input):
    """A roll-out to begin."""

    revision: Annotated[int, Field(ge=1, le=2**31 - 1)]
    channel: Channel = "stable"
    stages: Annotated[list[StageIn], Field(min_length=1, max_length=20)]
    failure_limit: int = Field(
        1, ge=1, le=10_000, description="It stops by itself when so many robots have failed."
    )

    override: Text | None = Field(
        None, description="Why it begins although gates are closed; kept in the history of the channel."
    )

    def plan(self) -> Plan:
        """Return what is asked for."""
        stages = tuple(stage.stage() for stage in self.stages)
        return Plan(self.revision, stages, self.failure_limit, self.override)

    @model_validator(mode="after")
    def _grows(self) -> Self:
        shares = [stage.share for stage in self.stages if stage.share is not None]
        if any(later <= earlier for earlier, later in pairwise(shares)):
            msg = "each share has to be larger than the one before"
            raise ValueError(msg)
        return self


class StageOut(Output):
    """One stage, as it was asked for."""

    group: str | None
    share: float | None
    threshold: float
    min_s: float


class StepOut(Output):
    """One thing that happened to a roll-out; `key_id` is null where nobody asked for it."""

    kind: RolloutStepKind
    stage: int = Field(description="The stage that it was in, from 0.")
    detail: str | None
    at: datetime
    key_id: str | None


class FailedRobotOut(Output):
    """A robot that failed with the revision, and what it said."""

    robot_id: str
    name: str
    detail: str | None


class RolloutOut(Output):
    """A roll-out: how far it is, who failed, and what happened to it."""

    id: str
    map_id: str
    channel: str
    revision: int = Field(description="What the robots get.")
    from_revision: int = Field(description="What the channel points to until the end.")
    state: RolloutState
    override: str | None = Field(description="Why it began although gates were closed.")
    reason: str | None = Field(description="Why it stopped: the robots that failed, with their words.")
    stages: list[StageOut]
    stage: int = Field(description="The present stage, from 0.")
    stage_began_at: datetime
    failure_limit: int
    taken: int | None = Field(description="Robots that have the revision from the stages so far.")
    enabled: int | None = Field(description="Those of them that run it, by their own word.")
    failed: list[FailedRobotOut] = Field(
        description="Robots that failed and do not run it; at most 20, and none in lists."
    )
    steps: list[StepOut]
    created_at: datetime
    created_by: str
    ended_at: datetime | None

    @classmethod
    def of(cls, shown: Shown) -> Self:
        """Return a roll-out as JSON."""
        row, figures = shown.rollout, shown.figures
        return cls(
            id=row.id,
            map_id=row.map_id,
            channel=row.channel,
            revision=row.revision_n,
            from_revision=row.from_n,
            state=RolloutState(row.state),
            override=row.override,
            reason=row.reason,
            stages=[StageOut(**kept) for kept in row.stages],
            stage=row.stage,
            stage_began_at=row.stage_began_at,
            failure_limit=row.failure_limit,
            taken=None if figures is None else figures.taken,
            enabled=None if figures is None else figures.enabled,
            failed=[
                FailedRobotOut(robot_id=robot.id, name=robot.name, detail=said)
                for robot, said in shown.failed
            ],
            steps=[StepOut.model_validate(step) for step in shown.steps],
            created_at=row.created_at,
            created_by=row.created_by,
            ended_at=row.ended_at,
        )
