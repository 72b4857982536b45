"""Which robots a roll-out gives its revision: those that its stages so far take, and nobody beside it."""

from __future__ import annotations

from service.db import rollouts as table
from service.db.robots import Robot
from service.db.rollouts import Rollout
from service.db.session import Session
from service.domain.errors import RolloutUnderWay
from service.domain.rollout import RolloutState, Stage, bound_of, takes


def stages_of(rollout: Rollout) -> list[Stage]:
    """Return the stages of a roll-out, in their order."""
    return [Stage.from_json(kept) for kept in rollout.stages]


def take_stage(session: Session, rollout: Rollout) -> int:
    """Give the revision to the robots that the stages so far take, and return how many they are."""
    begun = stages_of(rollout)[: rollout.stage + 1]
    robots = table.robots_of_channel(session, rollout.map_id, channel=rollout.channel)
    share = begun[-1].share
    if share is not None:
        bound = bound_of(rollout.id, (robot_id for robot_id, _ in robots), share=share)
        rollout.bound = max(bound, rollout.bound or "")
    taken = [
        robot_id
        for robot_id, group in robots
        if takes(rollout.id, robot_id, group=group, begun=begun, bound=rollout.bound)
    ]
    table.assign(session, rollout, taken)
    return len(taken)


def place_robot(session: Session, robot: Robot) -> None:
    """Let a robot that is new to its channel or group have what the roll-out there gives it, if there is one.

    A stopped roll-out takes nobody, and keeps who runs its revision.
    """
    rollout = table.open_rollout(session, robot.map_id, channel=robot.channel)
    if rollout is None:
        robot.assigned_n = None
        return
    begun = stages_of(rollout)[: rollout.stage + 1]
    taken = takes(rollout.id, robot.id, group=robot.group_name, begun=begun, bound=rollout.bound)
    if rollout.state == RolloutState.STOPPED:
        taken = taken and robot.enabled_n == rollout.revision_n
    robot.assigned_n = rollout.revision_n if taken else None


def refuse_under_way(session: Session, map_id: str, *, channel: str) -> None:
    """Pass when no roll-out decides what a channel's robots have.

    Raises
    ------
    RolloutUnderWay
        If one has not ended.
    """
    rollout = table.open_rollout(session, map_id, channel=channel)
    if rollout is not None:
        raise RolloutUnderWay(
            f"The roll-out {rollout.id} of revision {rollout.revision_n} is {rollout.state} on the channel"
            f" {channel!r}: wait for its end, or abort it.",
            rollout_id=rollout.id,
        )
