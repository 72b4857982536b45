"""Robots: what they were told to have, and what they report to have."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import (
    CheckConstraint,
    ColumnElement,
    ForeignKey,
    Index,
    Select,
    String,
    Text,
    and_,
    func,
    or_,
    select,
)
from sqlalchemy.orm import Mapped, Session, mapped_column

from service.db.models import Base, Channel, Id, Map, Name, Sha256
from service.domain.lifecycle import RobotState

_STATES = f"IN ({', '.join(repr(str(state)) for state in RobotState)})"


class Robot(Base):
    """An enrolled device, the channel that it follows, and its latest report; `enabled_n` is what it runs.

    `assigned_n` is what a roll-out gives it; null: what its channel points to. `manufacturer` and
    `serial_number` name it on an MQTT broker, where it speaks VDA 5050; `remark` is what is wrong with
    what it says there.
    """

    __tablename__ = "robots"
    __table_args__ = (
        CheckConstraint(f"state {_STATES}", name="state"),
        Index(None, "map_id", "id"),
        Index(None, "map_id", "channel", "assigned_n"),
        Index(None, "manufacturer", "serial_number", unique=True),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    name: Mapped[str] = mapped_column(Name)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id"))
    channel: Mapped[str] = mapped_column(String(40))
    group_name: Mapped[str | None] = mapped_column(String(40))
    key_id: Mapped[str] = mapped_column(ForeignKey("keys.id"), unique=True)
    created_at: Mapped[datetime]
    enabled_n: Mapped[int | None]
    state: Mapped[str | None] = mapped_column(String(16))
    reported_n: Mapped[int | None]
    reported_at: Mapped[datetime | None]
    detail: Mapped[str | None] = mapped_column(Text)
    assigned_n: Mapped[int | None]
    manufacturer: Mapped[str | None] = mapped_column(String(100))
    serial_number: Mapped[str | None] = mapped_column(String(100))
    remark: Mapped[str | None] = mapped_column(Text)


class RobotReport(Base):
    """One report of a robot, as it came."""

    __tablename__ = "robot_reports"
    __table_args__ = (
        CheckConstraint(f"state {_STATES}", name="state"),
        Index(None, "robot_id", "id"),
        Index(None, "state", "id"),
    )

    id: Mapped[str] = mapped_column(Id, primary_key=True)
    robot_id: Mapped[str] = mapped_column(ForeignKey("robots.id"))
    revision_n: Mapped[int]
    state: Mapped[str] = mapped_column(String(16))
    sha256: Mapped[str | None] = mapped_column(Sha256)
    detail: Mapped[str | None] = mapped_column(Text)
    at: Mapped[datetime]


_WANTED = func.coalesce(Robot.assigned_n, Channel.revision_n)


@dataclass(frozen=True)
class RobotFilter:
    """Hold which robots are asked for; None asks for all.

    Parameters
    ----------
    covered : collection of str, optional
        Only robots of these maps.
    behind : bool, optional
        Only robots that do not run what they should, or only those that do. A robot of a channel on which
        nothing is published is not behind.
    assigned : bool
        Only robots that have their revision from a roll-out.
    """

    covered: Collection[str] | None = None
    map_id: str | None = None
    channel: str | None = None
    group_name: str | None = None
    behind: bool | None = None
    assigned: bool = False


def find_robot(session: Session, robot_id: str, *, lock: bool = False) -> Robot | None:
    """Return the robot with this id, or None; with `lock` no other transaction changes it meanwhile."""
    return session.get(Robot, robot_id, with_for_update=True if lock else None)


def find_robot_of_key(session: Session, key_id: str) -> Robot | None:
    """Return the robot whose own key this is, or None."""
    return session.scalars(select(Robot).where(Robot.key_id == key_id)).one_or_none()


@dataclass(frozen=True)
class Vehicle:
    """Hold a robot that has a name on an MQTT broker, and the revision that it should have.

    Parameters
    ----------
    next_n : int
        The number that its map's next revision gets: no revision has this one or a later one.
    """

    robot: Robot
    wanted_n: int | None
    next_n: int


def list_vehicles(session: Session) -> Sequence[Vehicle]:
    """Return the robots that have a name on an MQTT broker."""
    query = _with_pointer().add_columns(Map.next_revision).join(Map, Map.id == Robot.map_id)
    query = query.where(Robot.serial_number.is_not(None)).order_by(Robot.id)
    return [Vehicle(*row) for row in session.execute(query)]


def is_vehicle_known(session: Session, *, manufacturer: str, serial_number: str) -> bool:
    """Return whether a robot has this name on an MQTT broker."""
    same = and_(Robot.manufacturer == manufacturer, Robot.serial_number == serial_number)
    return session.scalar(select(Robot.id).where(same)) is not None


def list_robots(
    session: Session, wanted: RobotFilter, *, after: str | None, limit: int
) -> Sequence[tuple[Robot, int | None]]:
    """Return up to `limit` robots in the order of their enrolment, each with the revision it should have.

    Parameters
    ----------
    after : str, optional
        From after the robot with this id.
    """
    query = _with_pointer().order_by(Robot.id).limit(limit)
    for name in ("map_id", "channel", "group_name"):
        value = getattr(wanted, name)
        if value is not None:
            query = query.where(getattr(Robot, name) == value)
    if wanted.covered is not None:
        query = query.where(Robot.map_id.in_(wanted.covered))
    if wanted.assigned:
        query = query.where(Robot.assigned_n.is_not(None))
    if wanted.behind is not None:
        query = query.where(_is_behind() if wanted.behind else ~_is_behind())
    if after is not None:
        query = query.where(Robot.id > after)
    return [(row[0], row[1]) for row in session.execute(query)]


@dataclass(frozen=True)
class RobotGroup:
    """Hold how many robots of a channel should run the same revision, run the same, and said the same."""

    map_id: str
    channel: str
    wanted_n: int | None
    enabled_n: int | None
    state: str | None
    reported_n: int | None
    robots: int


def count_robots(
    session: Session, *, covered: Collection[str] | None, map_id: str | None
) -> Sequence[RobotGroup]:
    """Return the robots of these maps, counted by what they should run, run, and reported last."""
    columns = (
        Robot.map_id, Robot.channel, _WANTED, Robot.enabled_n, Robot.state, Robot.reported_n,
    )  # fmt: skip
    same = and_(Channel.map_id == Robot.map_id, Channel.name == Robot.channel)
    query = select(*columns, func.count()).select_from(Robot).outerjoin(Channel, same).group_by(*columns)
    if covered is not None:
        query = query.where(Robot.map_id.in_(covered))
    if map_id is not None:
        query = query.where(Robot.map_id == map_id)
    return [RobotGroup(*row) for row in session.execute(query.order_by(*columns[:3]))]


def wanted_revision(session: Session, robot: Robot) -> int | None:
    """Return the revision that a roll-out gives the robot, or that its channel points to, or None."""
    if robot.assigned_n is not None:
        return robot.assigned_n
    pointer = session.get(Channel, (robot.map_id, robot.channel))
    return None if pointer is None else pointer.revision_n


def list_reports(session: Session, robot_id: str, *, below: str | None, limit: int) -> Sequence[RobotReport]:
    """Return up to `limit` reports of a robot, newest first, with ids below `below`."""
    query = select(RobotReport).where(RobotReport.robot_id == robot_id).order_by(RobotReport.id.desc())
    if below is not None:
        query = query.where(RobotReport.id < below)
    return session.scalars(query.limit(limit)).all()


def _with_pointer() -> Select[Robot, int]:
    same = and_(Channel.map_id == Robot.map_id, Channel.name == Robot.channel)
    return select(Robot, _WANTED).outerjoin(Channel, same)


def _is_behind() -> ColumnElement[bool]:
    runs_another = or_(Robot.enabled_n.is_(None), Robot.enabled_n != _WANTED)
    return and_(_WANTED.is_not(None), runs_another)
