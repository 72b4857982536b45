"""What one vehicle sends, remembers or does reaches no other; two bridges take turns."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from service.settings import Settings
from tests.forked import Forked
from tests.patience import PATIENCE_S, soon
from tests.server import Server, running
from tests.service.asking import ok
from tests.worker.bridges import Plant, bridging, start_bridge
from tests.worker.vehicles import Overhearing, PlainVehicle, mosquitto

REPAIRED_S = 60.0


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    with mosquitto(tmp_path_factory.mktemp("mosquitto")) as port:
        yield port


@pytest.fixture(
    params=[
        pytest.param("2.1.0", id="2.1-sqlite"),
        pytest.param("3.0.0", id="3.0-postgres", marks=pytest.mark.postgres),
    ]
)
def version(request: pytest.FixtureRequest) -> str:
    """Return what the vehicles speak; the two databases are tried by the way."""
    spoken: str = request.param
    return spoken


@pytest.fixture
def served(request: pytest.FixtureRequest, version: str, tmp_path: Path) -> Iterator[Server]:
    url = SecretStr(request.getfixturevalue("postgres_url")) if version == "3.0.0" else None
    with running(Settings(data_dir=tmp_path / "data", database_url=url)) as server:
        yield server


def raw(vehicle: PlainVehicle, **more: Any) -> bytes:
    return json.dumps({**vehicle.state(), **more}).encode()


def test_what_one_vehicle_sends_is_told_of_it_and_the_others_are_served(
    served: Server, broker: int, version: str
) -> None:
    plant = Plant(served, revisions=3)
    bad, good = (PlainVehicle(broker, f"{name}-{plant.map_id}", version) for name in ("bad", "good"))
    for vehicle in (bad, good):
        plant.enrol(vehicle.serial_number)
    key, words = ("actionStates", "resultDescription") if version[0] == "2" else (
        "instantActionStates",
        "actionResult",
    )  # fmt: skip
    failed = {"actionId": "groundplan-downloadMap-1-1", "actionStatus": "FAILED"}
    huge = {"mapId": plant.map_id, "mapVersion": "9" * 5000, "mapStatus": "ENABLED"}
    try:
        with bridging(served, broker) as process:
            plant.publish(1)
            for vehicle in (bad, good):
                plant.until(vehicle.serial_number, enabled_revision=1, remark=None)
            bad.say("state", raw(bad, **{key: [{**failed, words: {"why": "disk full"}}]}))
            told = plant.until(bad.serial_number, remark=lambda text: text is not None)
            assert words in told["remark"]
            assert (told["state"], told["enabled_revision"]) == ("enabled", 1), "it has not failed"
            lone = json.dumps({**bad.state(), key: [{**failed, words: "\ud800"}]}).encode()
            assert b"\\ud800" in lone
            for payload in (lone, b"", b"[" * 100_000, b"1" * 5000, b"x" * (2 << 20)):
                bad.say("state", payload)
                bad.say("connection", payload)
            plant.publish(2)
            plant.until(good.serial_number, enabled_revision=2, remark=None)
            bad.tell()
            plant.until(bad.serial_number, patience_s=REPAIRED_S, enabled_revision=2, remark=None)
            bad.say("state", raw(bad, maps=[huge]))
            plant.until(bad.serial_number, remark=lambda text: text is not None and "9999..." in text)
            bad.tell()
            plant.publish(3)
            for vehicle in (bad, good):
                plant.until(vehicle.serial_number, patience_s=REPAIRED_S, enabled_revision=3, remark=None)
            assert process.poll() is None
    finally:
        bad.close()
        good.close()
    listed = ok(plant.admin.get("/v1/robots"))["items"]
    assert [one["remark"] for one in listed] == [None, None]


def test_an_unknown_version_is_told_and_the_vehicle_is_served(
    served: Server, broker: int, version: str
) -> None:
    plant = Plant(served, revisions=1)
    vehicle = PlainVehicle(broker, f"stranger-{plant.map_id}", version)
    vehicle._maps = {(plant.map_id, "99"): "ENABLED", (plant.map_id, "site plan"): "DISABLED"}
    vehicle.excuse = "not now"
    plant.enrol(vehicle.serial_number)
    try:
        with bridging(served, broker):
            told = plant.until(vehicle.serial_number, remark=lambda text: text is not None)
            assert "'99'" in told["remark"]
            vehicle.excuse = None
            plant.publish(1)
            plant.until(vehicle.serial_number, enabled_revision=1, progress="up-to-date", remark=None)
            assert vehicle.maps() == {"99": "DISABLED", "site plan": "DISABLED", "1": "ENABLED"}
    finally:
        vehicle.close()


def test_an_old_failure_stops_no_new_roll_out(served: Server, broker: int, version: str) -> None:
    plant = Plant(served, revisions=2)
    vehicle = PlainVehicle(broker, f"grudge-{plant.map_id}", version)
    plant.enrol(vehicle.serial_number)
    words = "actionResult" if version[0] == "3" else "resultDescription"
    stages = {"revision": 2, "stages": [{"share": 1.0}]}
    try:
        with bridging(served, broker):
            plant.publish(1)
            plant.until(vehicle.serial_number, enabled_revision=1)
        vehicle.remember("groundplan-downloadMap-2-1", actionStatus="FAILED", **{words: "disk full"})
        with bridging(served, broker):
            rollout = ok(plant.admin.post(f"/v1/maps/{plant.map_id}/rollouts", json=stages), 201)["id"]
            plant.until(vehicle.serial_number, enabled_revision=2)
            where = f"/v1/rollouts/{rollout}"
            soon(lambda: ok(plant.admin.get(where))["state"] == "finished", patience_s=PATIENCE_S)
    finally:
        vehicle.close()
    assert "failed" not in {state for _, state, _ in plant.reports(vehicle.serial_number)}


def test_a_failure_counts_again_in_a_second_roll_out(served: Server, broker: int, version: str) -> None:
    plant = Plant(served, revisions=2)
    vehicle = PlainVehicle(broker, f"twice-{plant.map_id}", version)
    plant.enrol(vehicle.serial_number)
    stages = {"revision": 2, "stages": [{"share": 1.0}]}
    try:
        with bridging(served, broker):
            plant.publish(1)
            plant.until(vehicle.serial_number, enabled_revision=1)
            vehicle.excuse = "disk full"
            for count in (1, 2):
                rollout = ok(plant.admin.post(f"/v1/maps/{plant.map_id}/rollouts", json=stages), 201)["id"]
                where = f"/v1/rollouts/{rollout}"
                soon(lambda: ok(plant.admin.get(where))["state"] == "stopped", patience_s=PATIENCE_S)  # noqa: B023
                ok(plant.admin.post(f"{where}/abort"))
                told = plant.reports(vehicle.serial_number)
                assert [report[1:] for report in told].count(("failed", "disk full")) == count
                time.sleep(2.0)
    finally:
        vehicle.close()


def test_a_map_is_enabled_when_the_vehicle_stands(served: Server, broker: int, version: str) -> None:
    plant = Plant(served, revisions=2)
    vehicle, overheard = PlainVehicle(broker, f"busy-{plant.map_id}", version), Overhearing(broker)
    plant.enrol(vehicle.serial_number)
    try:
        with bridging(served, broker):
            plant.publish(1)
            plant.until(vehicle.serial_number, enabled_revision=1)
            vehicle.is_driving = True
            vehicle.tell()
            plant.publish(2)
            plant.until(vehicle.serial_number, state="downloaded", reported_revision=2)
            time.sleep(3.0)
            assert vehicle.maps() == {"1": "ENABLED", "2": "DISABLED"}
            assert [a["actionType"] for a in overheard.actions()].count("enableMap") == 1
            vehicle.is_driving = False
            vehicle.tell()
            plant.until(vehicle.serial_number, enabled_revision=2)
    finally:
        vehicle.close()
        overheard.close()


@pytest.mark.parametrize("sig", [signal.SIGTERM, signal.SIGKILL])
def test_a_second_bridge_waits_and_goes_on_where_the_first_ended(
    served: Server, broker: int, sig: signal.Signals
) -> None:
    plant = Plant(served, revisions=2)
    vehicle, overheard = PlainVehicle(broker, f"two-{plant.map_id}"), Overhearing(broker)
    plant.enrol(vehicle.serial_number)
    logs = [served.settings.data_dir / f"bridge-{k}.log" for k in (1, 2)]
    bridges: list[Forked] = []
    try:
        for log, sign in zip(logs, ("connected to the broker", "this one waits"), strict=True):
            bridges.append(start_bridge(served, broker, log, GROUNDPLAN_LEASE_S="3", GROUNDPLAN_BEAT_S="0.5"))
            soon(lambda: sign in log.read_text(), patience_s=PATIENCE_S)  # noqa: B023
        plant.publish(1)
        plant.until(vehicle.serial_number, enabled_revision=1)
        time.sleep(5.0)
        assert "connected" not in logs[1].read_text()
        assert logs[0].read_text().count("connected to the broker") == 1, "neither throws the other out"
        bridges[0].send_signal(sig)
        bridges[0].wait(timeout=PATIENCE_S)
        plant.publish(2)
        plant.until(vehicle.serial_number, enabled_revision=2)
        assert "connected to the broker" in logs[1].read_text()
        asked = [(a["actionType"], a["actionId"]) for a in overheard.actions() if "Map" in a["actionType"]]
        assert len(set(asked)) == len(asked), "no action is asked for twice"
    finally:
        vehicle.close()
        overheard.close()
        for bridge in bridges:
            bridge.kill()
            bridge.wait()


POINTS = [
    f"{name}.{when}-commit"
    for name in ("hold-bridge-lease", "remark-on-robot", "end-bridge-lease")
    for when in ("before", "after")
]


def test_a_kill_at_each_point_of_the_bridge_leaves_the_next_one_free(served: Server, broker: int) -> None:
    plant = Plant(served, revisions=1)
    vehicle = PlainVehicle(broker, f"killed-{plant.map_id}")
    plant.enrol(vehicle.serial_number)
    quick = {"GROUNDPLAN_LEASE_S": "2", "GROUNDPLAN_BEAT_S": "0.2"}
    try:
        for point in POINTS:
            log = served.settings.data_dir / f"{point}.log"
            bridge = start_bridge(served, broker, log, GROUNDPLAN_CRASH_AT=point, **quick)
            if point.startswith("end-"):
                soon(lambda: "connected" in log.read_text(), patience_s=PATIENCE_S)  # noqa: B023
                bridge.terminate()
            elif point.startswith("remark-"):
                until = time.monotonic() + PATIENCE_S
                while bridge.poll() is None and time.monotonic() < until:
                    vehicle.say("state", b"{}")
                    time.sleep(0.2)
            assert bridge.wait(timeout=PATIENCE_S) == -signal.SIGKILL, point
        with bridging(served, broker):
            vehicle.tell()
            plant.publish(1)
            plant.until(vehicle.serial_number, patience_s=REPAIRED_S, enabled_revision=1, remark=None)
    finally:
        vehicle.close()
