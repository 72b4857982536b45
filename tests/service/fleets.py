"""A fleet in a test: robots with keys of their own, what each is told, and what it reports."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, TypeVar

import httpx

from tests.patience import soon
from tests.server import Server
from tests.service.asking import a_map, a_ready_revision, ok
from tests.service.by_hand import ByHand

T = TypeVar("T")


@dataclass(frozen=True)
class RobotInTest:
    """Hold a robot and its own way to the service."""

    id: str
    client: httpx.Client
    map_id: str

    def told(self) -> int:
        """Return the revision that the robot is told to run."""
        n: int = ok(self.client.get(f"/v1/maps/{self.map_id}/published"))["revision"]
        return n

    def say(self, state: str, revision: int, detail: str | None = None) -> None:
        """Report."""
        body = {"state": state, "revision": revision, "detail": detail}
        ok(self.client.post(f"/v1/robots/{self.id}/reports", json=body), 201)


class Fleet:
    """Hold a map with ready revisions, the first of which is published and run by every robot."""

    def __init__(self, server: Server, *, robots: int, canaries: int = 0, revisions: int = 2) -> None:
        self.server = server
        self.admin = server.client(server.admin_key)
        self.map_id = a_map(self.admin)
        for _ in range(revisions):
            a_ready_revision(self.admin, ByHand(server.kernel), self.map_id)
        self.publish(1)
        self.robots = [self.enrol("canary" if k < canaries else None) for k in range(robots)]
        for robot in self.robots:
            robot.say("enabled", 1)

    def enrol(self, group: str | None = None, **more: Any) -> RobotInTest:
        """Return a new robot."""
        body = {"name": f"AMR {time.monotonic_ns()}", "map_id": self.map_id, "group": group, **more}
        made = ok(self.admin.post("/v1/robots", json=body), 201)
        return RobotInTest(made["id"], self.server.client(made["key"]), self.map_id)

    def publish(self, n: int, channel: str = "stable") -> httpx.Response:
        """Publish a revision."""
        return self.admin.post(f"/v1/maps/{self.map_id}/revisions/{n}/publish", json={"channel": channel})

    def begin(self, *stages: dict[str, Any], revision: int = 2, **more: Any) -> str:
        """Return the id of a new roll-out."""
        body = {"revision": revision, "stages": list(stages), **more}
        made = ok(self.admin.post(f"/v1/maps/{self.map_id}/rollouts", json=body), 201)
        rollout_id: str = made["id"]
        return rollout_id

    def rollout(self, rollout_id: str) -> dict[str, Any]:
        """Return a roll-out as it is now."""
        return ok(self.admin.get(f"/v1/rollouts/{rollout_id}"))

    def change(self, rollout_id: str, verb: str) -> dict[str, Any]:
        """Pause, resume or abort."""
        return ok(self.admin.post(f"/v1/rollouts/{rollout_id}/{verb}"))

    def until(self, rollout_id: str, **wanted: Any) -> dict[str, Any]:
        """Return the roll-out when it is as wanted; it has to be so soon."""

        def is_so() -> dict[str, Any] | None:
            seen = self.rollout(rollout_id)
            return seen if all(seen[name] == value for name, value in wanted.items()) else None

        return soon(is_so)

    def having(self, n: int) -> list[RobotInTest]:
        """Return the robots that are told to run revision `n`."""
        return [robot for robot in self.robots if robot.told() == n]
