"""Between the fleet's records and the vehicles on the broker."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import structlog

from service.db.robots import Robot, list_vehicles
from service.db.robots import Vehicle as Enrolled
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import DomainError, Unavailable
from service.domain.lifecycle import RobotState, Role
from service.usecases.kernel import Kernel
from service.usecases.links import LONGEST_S, link_path, sign_link
from service.usecases.robots import remark_on, take_report
from worker.vda5050.course import Course, Step
from worker.vda5050.faults import Faults, Name
from worker.vda5050.messages import (
    OURS,
    Action,
    ActionState,
    ActionType,
    VehicleState,
    instant_actions,
    online_version,
    plain,
    read_state,
)
from worker.vda5050.schema import NoState

PACKAGE = "package.tar"

log = structlog.get_logger(__name__)

_SHOWN_VERSION = 40


class Send(Protocol):
    """Send a message to a topic."""

    def __call__(self, topic: str, payload: bytes) -> None:
        """Send it; it arrives at least once if the broker is there."""


@dataclass(frozen=True)
class _Heard:
    """Hold one message of a vehicle: its state; its version, when it came online; neither, when it went."""

    prefix: str
    state: VehicleState | None
    version: str | None = None


@dataclass
class _Vehicle:
    """Hold a vehicle as it was last heard, where it listens, and how far it is."""

    prefix: str
    state: VehicleState
    header_id: int = 0
    course: Course | None = None


class Bridge:
    """Bring each vehicle to the revision that its robot should have, and report what it says.

    Parameters
    ----------
    kernel : Kernel
        The fleet's records.
    send : Send
        Where messages go.
    base_url : str
        Address of the service as the vehicles reach it, for links.
    clock : callable
        Tells seconds that never go back.
    """

    def __init__(
        self, kernel: Kernel, *, send: Send, base_url: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._kernel = kernel
        self._send = send
        self._base_url = base_url.rstrip("/")
        self._clock = clock
        self._heard: dict[Name, _Heard] = {}
        self._wrong: dict[Name, str] = {}
        self._lock = threading.Lock()
        self._vehicles: dict[Name, _Vehicle] = {}
        self._faults = Faults()

    def hear(self, topic: str, payload: bytes) -> None:
        """Take a message of the topic `state` or `connection` of a vehicle; from any thread.

        One that comes online is asked for its state; one that goes is asked for nothing. A message that is
        not what the published schema says changes nothing but that this is told of its vehicle.
        """
        prefix, _, subtopic = topic.rpartition("/")
        _, manufacturer, serial_number = prefix.rsplit("/", 2)
        name = manufacturer, serial_number
        try:
            if subtopic == "state":
                heard = _Heard(prefix, read_state(payload))
            else:
                heard = _Heard(prefix, None, online_version(payload))
        except NoState as error:
            with self._lock:
                self._wrong[name] = plain(f"Its message on {subtopic} cannot be read: {error}")
            return
        with self._lock:
            self._heard[name] = heard

    def look(self) -> None:
        """Go through the robots that were heard: report what is new, and ask for what is next.

        Whatever is wrong with one vehicle is told of it, and the others are served.

        Raises
        ------
        Unavailable
            If the database did not answer: what was heard is kept for the next look.
        """
        with self._kernel.db.reading() as session:
            enrolled = {_name(one.robot): one for one in list_vehicles(session)}
        with self._lock:
            heard, self._heard = self._heard, {}
            wrong, self._wrong = self._wrong, {}
        for name in heard.keys() & enrolled:
            self._take(name, heard[name])
            self._faults.right(name)
        for name in wrong.keys() & enrolled:
            self._faults.wrong(name, wrong[name], now=self._clock())
        for name, one in enrolled.items():
            self._serve(name, one)

    def _serve(self, name: Name, one: Enrolled) -> None:
        """Follow one vehicle and say what is wrong with it; nothing that it does reaches another."""
        vehicle, remark = self._vehicles.get(name), self._faults.of(name, now=self._clock())
        try:
            if vehicle is not None:
                remark = self._follow(one, vehicle) or remark
        except Unavailable as error:
            log.warning("the database did not answer", why=error.detail)
            return
        except DomainError as refusal:
            remark = refusal.detail
        except Exception:
            log.exception("a vehicle cannot be followed", robot=one.robot.id)
            remark = "The bridge has a fault with this vehicle; its log has the details."
        if remark != one.robot.remark and (remark is not None or vehicle is not None):
            self._remark(one.robot, remark)

    def _remark(self, robot: Robot, remark: str | None) -> None:
        """Tell of a vehicle what is wrong with it, or that nothing is."""
        log.warning("what is wrong with a vehicle", robot=robot.id, remark=remark)
        try:
            remark_on(self._kernel, robot.id, remark)
        except Unavailable as error:
            log.warning("the database did not answer", why=error.detail)

    def _take(self, name: Name, heard: _Heard) -> None:
        """Remember what an enrolled vehicle has said."""
        if heard.state is not None:
            vehicle = self._vehicles.setdefault(name, _Vehicle(heard.prefix, heard.state))
            vehicle.prefix, vehicle.state = heard.prefix, heard.state
        elif heard.version is None:
            self._vehicles.pop(name, None)
        elif name not in self._vehicles:
            action = Action(f"{OURS}{self._kernel.new_id('act')}", ActionType.STATE, {})
            message = instant_actions(
                action,
                header_id=0,
                version=heard.version,
                manufacturer=name[0],
                serial_number=name[1],
                now=self._kernel.now(),
            )
            self._send(f"{heard.prefix}/instantActions", message)

    def _follow(self, one: Enrolled, vehicle: _Vehicle) -> str | None:
        """Report what is new of a vehicle and ask for what is next; return what is wrong with it, or None."""
        robot, wanted_n = one.robot, one.wanted_n
        if vehicle.course is None or vehicle.course.map_id != robot.map_id:
            vehicle.course = Course(robot.map_id)
        course = vehicle.course
        course.want(wanted_n)
        held = course.versions(vehicle.state, below=one.next_n)
        enabled = next((n for n, is_enabled in held.items() if is_enabled), None)
        if enabled is not None and robot.enabled_n != enabled:
            self._report(robot, enabled, RobotState.ENABLED)
        if wanted_n is not None:
            if wanted_n in held and enabled != wanted_n and not _has_told(robot, wanted_n):
                self._report(robot, wanted_n, RobotState.DOWNLOADED)
            if enabled != wanted_n:
                self._tell_failure(robot, wanted_n, course, vehicle.state)
            step = course.next_step(vehicle.state, wanted_n, now=self._clock(), below=one.next_n)
            if step is not None:
                self._ask(robot, vehicle, step)
        return None if enabled is not None else _foreign(vehicle.state, robot.map_id)

    def _tell_failure(self, robot: Robot, n: int, course: Course, state: VehicleState) -> None:
        """Pass on a failure: the first with this revision in any case, then each that has other words."""
        failed = course.failure(state, n)
        if failed is not None and not (course.has_told_failure and _has_told(robot, n, failed)):
            self._report(robot, n, RobotState.FAILED, detail=failed.result)
            course.has_told_failure = True

    def _report(self, robot: Robot, n: int, state: RobotState, *, detail: str | None = None) -> None:
        """Take a report as if the vehicle had sent it with its robot's own key."""
        log.info("a vehicle reports", robot=robot.id, revision=n, state=state.value)
        with self._kernel.db.writing("take-report") as session:
            take_report(
                self._kernel,
                session,
                _actor(robot),
                robot_id=robot.id,
                revision_n=n,
                state=state,
                sha256=None,
                detail=detail,
            )

    def _ask(self, robot: Robot, vehicle: _Vehicle, step: Step) -> None:
        parameters = {"mapId": robot.map_id, "mapVersion": str(step.n)}
        if step.type is ActionType.DOWNLOAD:
            with self._kernel.db.reading() as session:
                parameters |= self._package(session, robot, step.n)
        payload = instant_actions(
            Action(step.action_id, step.type, parameters),
            header_id=vehicle.header_id,
            version=vehicle.state.version,
            manufacturer=robot.manufacturer or "",
            serial_number=robot.serial_number or "",
            now=self._kernel.now(),
        )
        vehicle.header_id += 1
        log.info("a vehicle is asked", robot=robot.id, action=step.type.value, revision=step.n)
        self._send(f"{vehicle.prefix}/instantActions", payload)

    def _package(self, session: Session, robot: Robot, n: int) -> dict[str, str]:
        """Return link and hash of a revision's package: one file for one version of the map."""
        signed = sign_link(
            self._kernel, session, _actor(robot), map_id=robot.map_id, n=n, path=PACKAGE, valid_s=LONGEST_S
        )
        path = link_path(signed.signature, map_id=robot.map_id, n=n, path=PACKAGE)
        return {"mapDownloadLink": self._base_url + path, "mapHash": f"sha256:{signed.file.sha256}"}


def _name(robot: Robot) -> Name:
    return robot.manufacturer or "", robot.serial_number or ""


def _foreign(state: VehicleState, map_id: str) -> str | None:
    """Return what to say of a vehicle whose enabled version is no revision of the map, or None."""
    for (found_id, version), is_enabled in state.maps.items():
        if found_id == map_id and is_enabled:
            shown = version if len(version) <= _SHOWN_VERSION else f"{version[:_SHOWN_VERSION]}..."
            return plain(f"It uses the version {shown!r} of its map, which is none of the map's revisions.")
    return None


def _actor(robot: Robot) -> Actor:
    return Actor(robot.key_id, Role.ROBOT, frozenset({robot.map_id}))


def _has_told(robot: Robot, n: int, failed: ActionState | None = None) -> bool:
    """Return whether the robot's latest report is about the revision, and tells of the failure, if of one."""
    if robot.reported_n != n:
        return False
    return failed is None or (robot.state == RobotState.FAILED and robot.detail == failed.result)
