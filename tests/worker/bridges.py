"""The real bridge between a service's records and a broker, and a plant with vehicles to follow."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from tests.forked import Forked, forked
from tests.patience import PATIENCE_S, soon
from tests.server import Server, environment
from tests.service.asking import a_map, ok
from tests.service.by_hand import ByHand
from tests.worker.vehicle_messages import MAKER


def start_bridge(server: Server, port: int, log: Path, **more: str) -> Forked:
    """Return the process of a bridge that has just begun, with its words in a file."""
    told = {"GROUNDPLAN_MQTT_URL": f"mqtt://127.0.0.1:{port}", "GROUNDPLAN_PUBLIC_URL": server.url, **more}
    with log.open("ab") as words:
        return forked("worker.vda5050", env=environment(server.settings, **told), stdout=words, stderr=words)


@contextmanager
def bridging(server: Server, port: int) -> Iterator[Forked]:
    """Run a bridge, which has to live until it is told to stop."""
    log = server.settings.data_dir / "vda5050.log"
    process = start_bridge(server, port, log)
    try:
        yield process
        assert process.poll() is None, log.read_text()
        process.terminate()
        assert process.wait(timeout=PATIENCE_S) == 0, log.read_text()
    finally:
        process.kill()
        process.wait()


def packaged(n: int) -> bytes:
    """Return the bytes of a revision's package."""
    return b"the package of revision %d" % n


class Plant:
    """Hold a map with ready revisions and the robots that are enrolled for it."""

    def __init__(self, server: Server, *, revisions: int) -> None:
        self.server = server
        self.admin = server.client(server.admin_key)
        self.map_id = a_map(self.admin)
        self._robots: dict[str, str] = {}
        by_hand = ByHand(server.kernel)
        drawing = by_hand.drawing(self.map_id)
        for n in range(1, revisions + 1):
            asked = ok(
                self.admin.post(f"/v1/maps/{self.map_id}/revisions", json={"drawing_id": drawing}), 202
            )
            by_hand.build(asked["job"]["id"], more={"package.tar": packaged(n)})

    def try_to_enrol(self, serial_number: str) -> httpx.Response:
        """Return the answer to enrolling a vehicle."""
        vehicle = {"manufacturer": MAKER, "serial_number": serial_number}
        body = {"name": serial_number, "map_id": self.map_id, "vehicle": vehicle}
        return self.admin.post("/v1/robots", json=body)

    def enrol(self, serial_number: str) -> None:
        """Enrol a vehicle."""
        self._robots[serial_number] = ok(self.try_to_enrol(serial_number), 201)["id"]

    def publish(self, n: int) -> None:
        """Publish a revision to every vehicle."""
        ok(self.admin.post(f"/v1/maps/{self.map_id}/revisions/{n}/publish", json={}))

    def robot(self, serial_number: str) -> dict[str, Any]:
        """Return what the service says of a vehicle."""
        told: dict[str, Any] = ok(self.admin.get(f"/v1/robots/{self._robots[serial_number]}"))
        return told

    def reports(self, serial_number: str) -> list[tuple[int, str, str | None]]:
        """Return what a vehicle has reported, the oldest first."""
        items = ok(self.admin.get(f"/v1/robots/{self._robots[serial_number]}/reports"))["items"]
        return [(one["revision"], one["state"], one["detail"]) for one in items[::-1]]

    def until(self, serial_number: str, *, patience_s: float = PATIENCE_S, **wanted: Any) -> dict[str, Any]:
        """Return what the service says of a vehicle as soon as it is as wanted; a value may be a test."""

        def look() -> dict[str, Any] | None:
            seen = self.robot(serial_number)
            return seen if all(_fits(seen[k], v) for k, v in wanted.items()) else None

        found: dict[str, Any] = soon(look, patience_s=patience_s)
        return found


def _fits(value: object, wanted: object | Callable[[object], bool]) -> bool:
    return bool(wanted(value)) if callable(wanted) else value == wanted
