"""Maps for vehicles that speak VDA 5050: a real broker, the real process, vehicles of 2.1 and 3.0."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import SecretStr
from vda5050.validation import SchemaValidator

from service.settings import Settings
from tests.server import ROOT, Server, environment, running
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import ByHand
from tests.service.fleets import soon
from tests.worker.vehicles import (
    MAKER,
    Overhearing,
    PackageVehicle,
    PlainVehicle,
    VehicleInTest,
    mosquitto,
)
from worker.vda5050.course import Course
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

PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    with mosquitto(tmp_path_factory.mktemp("mosquitto")) as port:
        yield port


@pytest.fixture(
    params=[
        pytest.param((PlainVehicle, "sqlite"), id="3.0-sqlite"),
        pytest.param((PackageVehicle, "postgres"), id="2.1-postgres", marks=pytest.mark.postgres),
    ]
)
def case(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Server, type[VehicleInTest]]]:
    kind, database = request.param
    url = SecretStr(request.getfixturevalue("postgres_url")) if database == "postgres" else None
    with running(Settings(data_dir=tmp_path / "data", database_url=url)) as server:
        yield server, kind


@contextmanager
def bridging(server: Server, port: int) -> Iterator[None]:
    """Run the real process between a service's records and a broker."""
    told = {"GROUNDPLAN_MQTT_URL": f"mqtt://127.0.0.1:{port}", "GROUNDPLAN_PUBLIC_URL": server.url}
    with (server.settings.data_dir / "vda5050.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "worker.vda5050"],
            cwd=ROOT,
            env=environment(server.settings, **told),
            stdout=log,
            stderr=log,
        )
    try:
        yield
        process.terminate()
        assert process.wait(timeout=20) == 0
    finally:
        process.kill()
        process.wait()


def packaged(n: int) -> bytes:
    return b"the package of revision %d" % n


def enrol(admin: httpx.Client, map_id: str, serial_number: str) -> httpx.Response:
    vehicle = {"manufacturer": MAKER, "serial_number": serial_number}
    return admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id, "vehicle": vehicle})


def revisions(admin: httpx.Client, by_hand: ByHand, map_id: str, *, count: int) -> None:
    drawing = by_hand.drawing(map_id)
    for n in range(1, count + 1):
        asked = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": drawing}), 202)
        by_hand.build(asked["job"]["id"], more={"package.tar": packaged(n)})


def test_a_vehicle_fetches_uses_and_drops_revisions(
    case: tuple[Server, Callable[[int, str], VehicleInTest]], broker: int
) -> None:
    served, kind = case
    admin, by_hand = served.client(served.admin_key), ByHand(served.kernel)
    map_id = a_map(admin)
    revisions(admin, by_hand, map_id, count=4)
    robot = ok(enrol(admin, map_id, f"AMR-{map_id[-8:]}"), 201)
    refused(enrol(admin, map_id, robot["serial_number"]), 409, "vehicle-taken")

    def publish(n: int) -> None:
        ok(admin.post(f"/v1/maps/{map_id}/revisions/{n}/publish", json={}))

    def until(**wanted: Any) -> dict[str, Any]:
        def look() -> dict[str, Any] | None:
            seen = ok(admin.get(f"/v1/robots/{robot['id']}"))
            return seen if all(seen[k] == v for k, v in wanted.items()) else None

        return soon(look, patience_s=PATIENCE_S)

    overheard, vehicle = Overhearing(broker), kind(broker, robot["serial_number"])
    try:
        with bridging(served, broker):
            publish(1)
            until(enabled_revision=1, progress="up-to-date")
            publish(2)
            until(enabled_revision=2, progress="up-to-date")
            assert vehicle.maps() == {"1": "DISABLED", "2": "ENABLED"}
        publish(3)
        with bridging(served, broker):
            until(enabled_revision=3)
            soon(lambda: vehicle.maps() == {"2": "DISABLED", "3": "ENABLED"}, patience_s=PATIENCE_S)
            vehicle.excuse = "the hash does not match"
            publish(4)
            failed = until(state="failed", reported_revision=4)
            assert (failed["detail"], failed["enabled_revision"]) == (vehicle.excuse, 3)
            vehicle.excuse = None
            publish(2)
            until(enabled_revision=2, progress="up-to-date")
    finally:
        vehicle.close()
        overheard.close()
    assert vehicle.fetched == [packaged(1), packaged(2), packaged(3)], "2 was still there to go back to"
    reports = ok(admin.get(f"/v1/robots/{robot['id']}/reports"))["items"][::-1]
    assert [(r["revision"], r["state"]) for r in reports if r["state"] != "downloaded"] == [
        (1, "enabled"),
        (2, "enabled"),
        (3, "enabled"),
        (4, "failed"),
        (2, "enabled"),
    ]
    _check_messages(overheard.messages, robot["serial_number"], kind)


def _check_messages(messages: list[dict[str, Any]], serial_number: str, kind: object) -> None:
    """Hold every message against the published schema (2.1), and what 3.0 says more narrowly."""
    schema = SchemaValidator()
    version = "2.1.0" if kind is PackageVehicle else "3.0.0"
    for message in messages:
        assert schema.errors("instantActions", message) == []
        assert (message["version"], message["manufacturer"]) == (version, MAKER)
        assert message["serialNumber"] == serial_number
        assert {action["blockingType"] for action in message["actions"]} == {"NONE"}
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", message["timestamp"])
    asked = [(a["actionType"], a["actionId"]) for m in messages for a in m["actions"]]
    assert len(set(asked)) == len(asked), "no action is asked for twice"
    kinds = [name for name, _ in asked]
    assert kinds.count("downloadMap") == 4
    assert kinds.count("deleteMap") >= 1


def a_state(maps: dict[str, bool] | None = None, **actions: ActionState) -> VehicleState:
    known = {name.replace("_", "-"): state for name, state in actions.items()}
    return VehicleState("2.1.0", {("map_1", n): on for n, on in (maps or {}).items()}, known)


def test_what_fails_is_asked_again_later_and_later_and_silence_is_not_waited_out() -> None:
    course = Course("map_1")
    first = course.next_step(a_state(), 7, now=0.0)
    assert first is not None
    assert (first.type, first.n, first.action_id) == (ActionType.DOWNLOAD, 7, "groundplan-downloadMap-7-1")
    assert course.next_step(a_state(), 7, now=29.0) is None
    second = course.next_step(a_state(), 7, now=30.0)
    assert second is not None
    failed = a_state(groundplan_downloadMap_7_2=ActionState("FAILED", "disk full"))
    failure = course.failure(failed, 7)
    assert failure is not None
    assert failure.result == "disk full"
    assert course.next_step(failed, 7, now=40.0) is None
    assert course.next_step(failed, 7, now=40.0 + 119.0) is None
    third = course.next_step(failed, 7, now=40.0 + 120.0)
    assert third is not None
    assert third.action_id == "groundplan-downloadMap-7-3"
    running = a_state(groundplan_downloadMap_7_3=ActionState("RUNNING", None))
    assert course.next_step(running, 7, now=1e9) is None


def test_a_new_process_goes_on_where_the_vehicle_says() -> None:
    running = a_state(groundplan_downloadMap_7_1=ActionState("RUNNING", None))
    assert Course("map_1").next_step(running, 7, now=0.0) is None
    done = a_state({"7": False}, groundplan_downloadMap_7_1=ActionState("FINISHED", None))
    step = Course("map_1").next_step(done, 7, now=0.0)
    assert step is not None
    assert (step.type, step.n) == (ActionType.ENABLE, 7)
    everything = a_state({"7": True, "6": False, "5": False, "beta": False})
    tidy = Course("map_1").next_step(everything, 7, now=0.0)
    assert tidy is not None
    assert (tidy.type, tidy.n) == (ActionType.DELETE, 5)


@pytest.mark.parametrize(
    "payload", [b"", b"[]", b"null", b'{"version": "2.1.0", "maps": [1]}', b"\xff", b"{}"]
)
def test_what_is_no_state_is_refused(payload: bytes) -> None:
    with pytest.raises(NoState):
        read_state(payload)
    with pytest.raises(NoState):
        online_version(payload)


def test_a_message_is_what_the_published_schema_says() -> None:
    action = Action("a", ActionType.ENABLE, {"mapId": "map_1", "mapVersion": "7"})
    now = datetime(2026, 1, 1, tzinfo=UTC)
    message = instant_actions(
        action, header_id=3, version="2.1.0", manufacturer=MAKER, serial_number="1", now=now
    )
    assert SchemaValidator().errors("instantActions", json.loads(message)) == []
