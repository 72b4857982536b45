"""Enrol robots, take their reports, and tell who is behind and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum

from service.db import robots as table
from service.db.robots import Robot, RobotFilter, RobotGroup, RobotReport
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import RevisionNotFound, RobotNotFound, VehicleTaken
from service.domain.lifecycle import RobotState, Role
from service.domain.webhook import EventKind
from service.usecases.audit import record
from service.usecases.events import emit
from service.usecases.kernel import Kernel
from service.usecases.keys import NewKey, create_key
from service.usecases.maps import covered_map
from service.usecases.rollout_members import place_robot

_STAFF = (Role.TABLET, Role.ADMIN)


class Progress(StrEnum):
    """How far a robot has come with the revision that it should have."""

    NOTHING_PUBLISHED = "nothing-published"
    NEVER_REPORTED = "never-reported"
    NOT_BEGUN = "not-begun"
    NOT_ENABLED = "not-enabled"
    FAILED = "failed"
    UP_TO_DATE = "up-to-date"


def progress_of(robot: Robot | RobotGroup, wanted_n: int | None) -> Progress:
    """Return how far robots have come with a revision, or with None; the latest report decides."""
    if wanted_n is None:
        return Progress.NOTHING_PUBLISHED
    if robot.enabled_n == wanted_n:
        return Progress.UP_TO_DATE
    if robot.state is None:
        return Progress.NEVER_REPORTED
    if robot.reported_n != wanted_n:
        return Progress.NOT_BEGUN
    return Progress.FAILED if robot.state == RobotState.FAILED else Progress.NOT_ENABLED


@dataclass(frozen=True)
class Followed:
    """Hold a robot with the revision that it should have; None when nothing is published on its channel."""

    robot: Robot
    wanted_n: int | None

    @property
    def progress(self) -> Progress:
        """Return how far the robot has come; the latest report decides."""
        return progress_of(self.robot, self.wanted_n)

    @property
    def is_behind(self) -> bool:
        """Return whether the robot should run another revision than it does."""
        return self.progress not in {Progress.NOTHING_PUBLISHED, Progress.UP_TO_DATE}


@dataclass(frozen=True)
class Vehicle:
    """Hold how a robot is named on an MQTT broker, where it speaks VDA 5050."""

    manufacturer: str
    serial_number: str


@dataclass(frozen=True)
class Device:
    """Hold what a robot is called, the map and the channel that it follows, and its group if it has one."""

    name: str
    map_id: str
    channel: str
    group: str | None = None
    vehicle: Vehicle | None = None


@dataclass(frozen=True)
class Enrolled:
    """Hold a robot just enrolled, and its key, whose secret is shown once."""

    followed: Followed
    key: NewKey


def enrol_robot(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    device: Device,
    root: str | None = None,
) -> Enrolled:
    """Return a new robot of a map with a key of its own, which covers that map alone.

    Parameters
    ----------
    device : Device
        What it is called, and what it follows.
    root : str, optional
        As `create_key`.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    MapNotFound
        If there is no such map for the key.
    VehicleTaken
        If another robot is this vehicle.
    """
    actor.require_role(Role.ADMIN)
    map_id, vehicle = device.map_id, device.vehicle
    covered_map(session, actor, map_id=map_id)
    if vehicle is not None and table.is_vehicle_known(
        session, manufacturer=vehicle.manufacturer, serial_number=vehicle.serial_number
    ):
        raise VehicleTaken(f"{vehicle.manufacturer} {vehicle.serial_number} is enrolled already.")
    key = create_key(kernel, session, name=device.name, role=Role.ROBOT, map_ids=[map_id], root=root)
    robot = Robot(
        id=kernel.new_id("rob"),
        name=device.name,
        map_id=map_id,
        channel=device.channel,
        group_name=device.group,
        key_id=key.key.id,
        created_at=kernel.now(),
        manufacturer=None if vehicle is None else vehicle.manufacturer,
        serial_number=None if vehicle is None else vehicle.serial_number,
    )
    session.add(robot)
    place_robot(session, robot)
    session.flush()
    after = {**asdict(device), "key_id": key.key.id}
    record(kernel, session, actor, action="enrol-robot", subject_id=robot.id, map_id=map_id, after=after)
    return Enrolled(_followed(session, robot), key)


def change_robot(
    kernel: Kernel, session: Session, actor: Actor, *, robot_id: str, changes: dict[str, str | None]
) -> Followed:
    """Return the robot with another name, channel or group: what `changes` names.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    RobotNotFound
        If there is no such robot for the key.
    """
    actor.require_role(Role.ADMIN)
    robot = _found(session, actor, robot_id, others=(Role.ADMIN,), lock=True)
    columns = {name: {"group": "group_name"}.get(name, name) for name in changes}
    before = {name: getattr(robot, column) for name, column in columns.items()}
    for name, value in changes.items():
        setattr(robot, columns[name], value)
    if changes.keys() & {"channel", "group"}:
        place_robot(session, robot)
    session.flush()
    record(
        kernel,
        session,
        actor,
        action="change-robot",
        subject_id=robot_id,
        map_id=robot.map_id,
        before=before,
        after=changes,
    )
    return _followed(session, robot)


def take_report(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    robot_id: str,
    revision_n: int,
    state: RobotState,
    sha256: str | None,
    detail: str | None,
) -> Followed:
    """Return the robot after its report; the report is kept as it came.

    Raises
    ------
    Forbidden
        If the key is neither the robot's own nor an admin's.
    RobotNotFound
        If there is no such robot for the key.
    RevisionNotFound
        If the map never had this revision.
    """
    robot = _found(session, actor, robot_id, others=(Role.ADMIN,), lock=True)
    if revision_n >= covered_map(session, actor, map_id=robot.map_id).next_revision:
        raise RevisionNotFound(f"The map {robot.map_id} never had a revision {revision_n}.")
    now = kernel.now()
    report = RobotReport(
        id=kernel.new_id("rep"),
        robot_id=robot.id,
        revision_n=revision_n,
        state=state.value,
        sha256=sha256,
        detail=detail,
        at=now,
    )
    session.add(report)
    robot.state, robot.reported_n, robot.reported_at = state.value, revision_n, now
    robot.detail = detail
    if state is RobotState.ENABLED:
        robot.enabled_n = revision_n
    if state is RobotState.FAILED:
        told = {"robot_id": robot.id, "name": robot.name, "revision": revision_n, "detail": detail}
        emit(kernel, session, EventKind.ROBOT_FAILED, map_id=robot.map_id, told=told)
    session.flush()
    return _followed(session, robot)


def remark_on(kernel: Kernel, robot_id: str, remark: str | None) -> None:
    """Keep what is wrong with what a vehicle says, or None when all is well; its reports stay as they are."""
    with kernel.db.writing("remark-on-robot") as session:
        robot = table.find_robot(session, robot_id, lock=True)
        if robot is not None:
            robot.remark = remark


def show_robot(session: Session, actor: Actor, *, robot_id: str) -> Followed:
    """Return a robot.

    Raises
    ------
    Forbidden
        If the key is another robot's.
    RobotNotFound
        If there is no such robot for the key.
    """
    return _followed(session, _found(session, actor, robot_id, others=_STAFF))


def list_robots(
    session: Session, actor: Actor, wanted: RobotFilter, *, after: str | None, limit: int
) -> list[Followed]:
    """Return up to `limit` robots of the maps that the key covers, in the order of their enrolment."""
    rows = table.list_robots(session, replace(wanted, covered=actor.map_ids), after=after, limit=limit)
    return [Followed(robot, wanted_n) for robot, wanted_n in rows]


def list_reports(
    session: Session, actor: Actor, *, robot_id: str, below: str | None, limit: int
) -> Sequence[RobotReport]:
    """Return up to `limit` reports of a robot, newest first.

    Raises
    ------
    Forbidden, RobotNotFound
        As `show_robot`.
    """
    robot = _found(session, actor, robot_id, others=_STAFF)
    return table.list_reports(session, robot.id, below=below, limit=limit)


def _found(
    session: Session, actor: Actor, robot_id: str, *, others: Sequence[Role], lock: bool = False
) -> Robot:
    """Return a robot, for its own key and for keys of the roles `others`."""
    robot = table.find_robot(session, robot_id, lock=lock)
    missing = RobotNotFound(f"There is no robot {robot_id}, or this key does not cover its map.")
    if robot is None:
        raise missing
    actor.require_map(robot.map_id, otherwise=missing)
    if actor.key_id != robot.key_id:
        actor.require_role(*others)
    return robot


def _followed(session: Session, robot: Robot) -> Followed:
    return Followed(robot, table.wanted_revision(session, robot))
