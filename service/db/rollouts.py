"""Roll-outs: a revision on its way to a channel's robots, stage by stage, and what happened to it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import (
    CheckConstraint,
    ColumnElement,
    ForeignKey,
    Index,
    Select,
    String,
    Text,
    and_,
    exists,
    func,
    or_,
    select,
    union,
    update,
)
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Id, Json
from service.db.robots import Robot, RobotReport
from service.domain.lifecycle import RobotState
from service.domain.rollout import RolloutState, RolloutStepKind

_BATCH = 500
_OPEN = tuple(state.value for state in RolloutState if not state.has_ended)


def _one_of(column: str, values: type[RolloutState | RolloutStepKind]) -> str:
    return f"{column} IN ({', '.join(repr(str(v)) for v in values)})"


class Rollout(Base):
    """A revision on its way to a channel's robots.

    `stage` counts the stages from 0; `bound` is the highest rank that shares take so far. Failures reported
    before `counts_from` stop nothing. `override` is why it began although the gates `overridden` were closed.
    """

    __tablename__ = "rollouts"
    __table_args__ = (
        CheckConstraint(_one_of("state", RolloutState), name="state"),
        Index(None, "map_id", "channel", "state"),
        Index(None, "map_id", "id"),
        Index(None, "state", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    channel: Mapped[str] = mapped_column(String(40))
    revision_n: Mapped[int]
    from_n: Mapped[int]
    state: Mapped[str] = mapped_column(String(16))
    stages: Mapped[list[Any]] = mapped_column(Json)
    stage: Mapped[int]
    stage_began_at: Mapped[datetime]
    bound: Mapped[str | None] = mapped_column(String(16))
    failure_limit: Mapped[int]
    counts_from: Mapped[datetime]
    reason: Mapped[str | None] = mapped_column(Text)
    override: Mapped[str | None] = mapped_column(Text)
    overridden: Mapped[list[Any] | None] = mapped_column(Json)
    created_at: Mapped[datetime]
    created_by: Mapped[str] = mapped_column(ForeignKey("keys.id"))
    ended_at: Mapped[datetime | None]


class RolloutStep(Base):
    """One thing that happened to a roll-out; `key_id` null where nobody asked for it."""

    __tablename__ = "rollout_steps"
    __table_args__ = (
        CheckConstraint(_one_of("kind", RolloutStepKind), name="kind"),
        Index(None, "rollout_id", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    rollout_id: Mapped[str] = mapped_column(ForeignKey("rollouts.id"))
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    kind: Mapped[str] = mapped_column(String(16))
    stage: Mapped[int]
    detail: Mapped[str | None] = mapped_column(Text)
    at: Mapped[datetime]
    key_id: Mapped[str | None] = mapped_column(ForeignKey("keys.id"))


@dataclass(frozen=True)
class Figures:
    """Hold how many robots the stages so far take, and how many of them run the revision."""

    taken: int
    enabled: int


def find_rollout(session: Session, rollout_id: str, *, lock: bool = False) -> Rollout | None:
    """Return the roll-out with this id, or None; with `lock` no other transaction changes it meanwhile."""
    return session.get(Rollout, rollout_id, with_for_update=True if lock else None, populate_existing=lock)


def open_rollout(session: Session, map_id: str, *, channel: str) -> Rollout | None:
    """Return the roll-out on a channel that has not ended, or None."""
    query = select(Rollout).where(
        Rollout.map_id == map_id, Rollout.channel == channel, Rollout.state.in_(_OPEN)
    )
    return session.scalars(query).one_or_none()


def running_rollouts(session: Session) -> Sequence[Rollout]:
    """Return the roll-outs that go on by themselves."""
    running = Rollout.state == RolloutState.RUNNING.value
    return session.scalars(select(Rollout).where(running).order_by(Rollout.id)).all()


def list_rollouts(
    session: Session,
    map_id: str,
    *,
    channel: str | None,
    state: RolloutState | None,
    below: str | None,
    limit: int,
) -> Sequence[Rollout]:
    """Return up to `limit` roll-outs of a map, newest first, with ids below `below`."""
    query = select(Rollout).where(Rollout.map_id == map_id).order_by(Rollout.id.desc()).limit(limit)
    if channel is not None:
        query = query.where(Rollout.channel == channel)
    if state is not None:
        query = query.where(Rollout.state == state.value)
    if below is not None:
        query = query.where(Rollout.id < below)
    return session.scalars(query).all()


def steps_of(session: Session, rollout_ids: Collection[str]) -> dict[str, list[RolloutStep]]:
    """Return what happened to each roll-out, in its order."""
    found: dict[str, list[RolloutStep]] = {rollout_id: [] for rollout_id in rollout_ids}
    query = select(RolloutStep).where(RolloutStep.rollout_id.in_(rollout_ids)).order_by(RolloutStep.id)
    for step in session.scalars(query):
        found[step.rollout_id].append(step)
    return found


def figures_of(session: Session, rollouts: Sequence[Rollout]) -> dict[str, Figures]:
    """Return the figures of each roll-out that has not ended."""
    query = (
        select(
            Rollout.id,
            func.count(Robot.id),
            func.count(Robot.id).filter(Robot.enabled_n == Rollout.revision_n),
        )
        .join(Robot, _is_of(Rollout))
        .where(Rollout.id.in_([row.id for row in rollouts]), Rollout.state.in_(_OPEN))
        .where(Robot.assigned_n == Rollout.revision_n)
        .group_by(Rollout.id)
    )
    found = {row[0]: Figures(row[1], row[2]) for row in session.execute(query)}
    return {row.id: found.get(row.id, Figures(0, 0)) for row in rollouts if row.state in _OPEN}


def robots_of_channel(session: Session, map_id: str, *, channel: str) -> Sequence[tuple[str, str | None]]:
    """Return the id and the group of every robot that follows a channel."""
    query = select(Robot.id, Robot.group_name).where(Robot.map_id == map_id, Robot.channel == channel)
    return [(row[0], row[1]) for row in session.execute(query)]


def failed_robots(
    session: Session, rollout: Rollout, *, after: str, limit: int
) -> Sequence[tuple[Robot, str | None]]:
    """Return up to `limit` robots that failed with the revision and do not run it, with their last words.

    Parameters
    ----------
    after : str
        Only reports with ids after this one count.
    """
    said = (
        select(RobotReport.detail)
        .where(_tells_failure(rollout, after))
        .order_by(RobotReport.id.desc())
        .limit(1)
        .scalar_subquery()
    )
    query = (
        select(Robot, said)
        .where(Robot.map_id == rollout.map_id, Robot.channel == rollout.channel)
        .where(Robot.assigned_n == rollout.revision_n, _runs_another(rollout))
        .where(exists().where(_tells_failure(rollout, after)))
        .order_by(Robot.id)
        .limit(limit)
    )
    return [(row[0], row[1]) for row in session.execute(query)]


def assign(session: Session, rollout: Rollout, robot_ids: Sequence[str]) -> None:
    """Let these robots have the roll-out's revision."""
    for begin in range(0, len(robot_ids), _BATCH):
        session.execute(
            update(Robot)
            .where(Robot.id.in_(robot_ids[begin : begin + _BATCH]))
            .values(assigned_n=rollout.revision_n)
        )


def unassign(session: Session, rollout: Rollout, *, keep_enabled: bool) -> None:
    """Let the channel's robots have what it points to again; with `keep_enabled` not those that run it."""
    query = update(Robot).where(_is_of(rollout), Robot.assigned_n.is_not(None)).values(assigned_n=None)
    session.execute(query.where(_runs_another(rollout)) if keep_enabled else query)


def _is_of(rollout: Rollout | type[Rollout]) -> ColumnElement[bool]:
    return and_(Robot.map_id == rollout.map_id, Robot.channel == rollout.channel)


def _runs_another(rollout: Rollout) -> ColumnElement[bool]:
    return or_(Robot.enabled_n.is_(None), Robot.enabled_n != rollout.revision_n)


def _tells_failure(rollout: Rollout, after: str) -> ColumnElement[bool]:
    return and_(
        RobotReport.robot_id == Robot.id,
        RobotReport.state == RobotState.FAILED.value,
        RobotReport.revision_n == rollout.revision_n,
        RobotReport.id > after,
    )


def under_way(map_id: str) -> Select[int]:
    """Return a query of the revisions of a map that open roll-outs bring, and those that they began from."""
    live = Rollout.map_id == map_id, Rollout.state.in_(_OPEN)
    both = union(select(Rollout.revision_n.label("n")).where(*live), select(Rollout.from_n).where(*live))
    return select(both.subquery().c.n)
