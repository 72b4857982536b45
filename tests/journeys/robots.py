"""The robot's client as a module, and a plant whose robots run it."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx

from tests.server import ROOT, Server
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import ByHand
from tests.service.halls import built_revision, make_delta

CLIENT = ROOT / "client" / "groundplan_robot.py"
CLOUD = "point-cloud.pcd"


def client_module() -> ModuleType:
    spec = importlib.util.spec_from_file_location("groundplan_robot", CLIENT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


client = client_module()


def sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@dataclass(frozen=True)
class Plant:
    """Hold a map with two revisions and the delta between them; revision 1 is published."""

    server: Server
    admin: httpx.Client
    map_id: str
    files: tuple[dict[str, bytes], dict[str, bytes]]

    def publish(self, n: int) -> None:
        """Publish a revision."""
        ok(self.admin.post(f"/v1/maps/{self.map_id}/revisions/{n}/publish", json={}))

    def enrol(self) -> dict[str, Any]:
        """Return a new robot with its key."""
        return ok(self.admin.post("/v1/robots", json={"name": "AMR", "map_id": self.map_id}), 201)

    def robot(self, folder: Path, *, url: str | None = None, **more: Any) -> Any:
        """Return the client of a new robot."""
        me = self.enrol()
        service = client.Service(url or self.server.url, me["key"])
        return client.Robot(service, client.Folder(folder), map_id=self.map_id, robot_id=me["id"], **more)

    def reports(self, robot: Any) -> list[tuple[int, str]]:
        """Return what a robot has reported, oldest first."""
        told = ok(self.admin.get(f"/v1/robots/{robot.robot_id}/reports"))["items"]
        return [(report["revision"], report["state"]) for report in reversed(told)]


def a_plant(server: Server, states: tuple[dict[str, bytes], dict[str, bytes]], folder: Path) -> Plant:
    """Return a new map whose two revisions have these files, with the deltas between them."""
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    for files in states:
        built_revision(admin, by_hand, map_id, files)
    for old, new in ((1, 2), (2, 1)):
        asked = admin.get(f"/v1/maps/{map_id}/revisions/{new}/delta?from={old}")
        if asked.status_code == 503:  # the same two clouds have one delta, on whatever map
            make_delta(by_hand, refused(asked, 503, "delta-not-ready")["job_id"], folder)
    plant = Plant(server, admin, map_id, states)
    plant.publish(1)
    return plant


def in_use(folder: Path) -> str:
    return sha256((folder / "current" / CLOUD).read_bytes())
