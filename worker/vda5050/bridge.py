"""Between the fleet's records and the vehicles on the broker."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import structlog
from sqlalchemy.orm import Session

from service.db.robots import Robot, list_vehicles
from service.domain.access import Actor
from service.domain.errors import DomainError
from service.domain.lifecycle import RobotState, Role
from service.usecases.kernel import Kernel
from service.usecases.links import LONGEST_S, link_path, sign_link
from service.usecases.robots import take_report
from worker.vda5050.course import Course, Step
from worker.vda5050.messages import (
    Action,
    ActionState,
    ActionType,
    NoState,
    VehicleState,
    instant_actions,
    online_version,
    read_state,
)

PACKAGE = "package.tar"

log = structlog.get_logger(__name__)

Name = tuple[str, str]
"""Manufacturer and serial number of a vehicle."""


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
        self._lock = threading.Lock()
        self._vehicles: dict[Name, _Vehicle] = {}

    def hear(self, topic: str, payload: bytes) -> None:
        """Take a message of the topic `state` or `connection` of a vehicle; from any thread.

        One that comes online is asked for its state; one that goes is asked for nothing.
        """
        prefix, _, subtopic = topic.rpartition("/")
        _, manufacturer, serial_number = prefix.rsplit("/", 2)
        try:
            if subtopic == "state":
                heard = _Heard(prefix, read_state(payload))
            else:
                heard = _Heard(prefix, None, online_version(payload))
        except NoState as error:
            log.warning("a message cannot be read", topic=topic, cause=str(error))
            return
        with self._lock:
            self._heard[manufacturer, serial_number] = heard

    def look(self) -> None:
        """Go through the robots that were heard: report what is new, and ask for what is next."""
        with self._lock:
            heard, self._heard = self._heard, {}
        with self._kernel.db.reading() as session:
            robots = list_vehicles(session)
        known = {(robot.manufacturer or "", robot.serial_number or "") for robot, _ in robots}
        for name in heard.keys() & known:
            self._take(name, heard[name])
        for robot, wanted_n in robots:
            vehicle_of = self._vehicles.get((robot.manufacturer or "", robot.serial_number or ""))
            if vehicle_of is None:
                continue
            try:
                self._follow(robot, wanted_n, vehicle_of)
            except DomainError as refusal:
                log.warning("a vehicle cannot be followed", robot=robot.id, cause=refusal.detail)

    def _take(self, name: Name, heard: _Heard) -> None:
        """Remember what an enrolled vehicle has said."""
        if heard.state is not None:
            vehicle = self._vehicles.setdefault(name, _Vehicle(heard.prefix, heard.state))
            vehicle.prefix, vehicle.state = heard.prefix, heard.state
        elif heard.version is None:
            self._vehicles.pop(name, None)
        elif name not in self._vehicles:
            action = Action(self._kernel.new_id("act"), ActionType.STATE, {})
            message = instant_actions(
                action,
                header_id=0,
                version=heard.version,
                manufacturer=name[0],
                serial_number=name[1],
                now=self._kernel.now(),
            )
            self._send(f"{heard.prefix}/instantActions", message)

    def _follow(self, robot: Robot, wanted_n: int | None, vehicle: _Vehicle) -> None:
        if vehicle.course is None or vehicle.course.map_id != robot.map_id:
            vehicle.course = Course(robot.map_id)
        course = vehicle.course
        held = course.versions(vehicle.state)
        enabled = next((n for n, is_enabled in held.items() if is_enabled), None)
        if enabled is not None and robot.enabled_n != enabled:
            self._report(robot, enabled, RobotState.ENABLED)
        if wanted_n is None:
            return
        if wanted_n in held and enabled != wanted_n and not _has_told(robot, wanted_n):
            self._report(robot, wanted_n, RobotState.DOWNLOADED)
        failed = course.failure(vehicle.state, wanted_n)
        if enabled != wanted_n and failed is not None and not _has_told(robot, wanted_n, failed):
            self._report(robot, wanted_n, RobotState.FAILED, detail=failed.result)
        step = course.next_step(vehicle.state, wanted_n, now=self._clock())
        if step is not None:
            self._ask(robot, vehicle, step)

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


def _actor(robot: Robot) -> Actor:
    return Actor(robot.key_id, Role.ROBOT, frozenset({robot.map_id}))


def _has_told(robot: Robot, n: int, failed: ActionState | None = None) -> bool:
    """Return whether the robot's latest report is about the revision, and tells of the failure, if of one."""
    if robot.reported_n != n:
        return False
    return failed is None or (robot.state == RobotState.FAILED and robot.detail == failed.result)
