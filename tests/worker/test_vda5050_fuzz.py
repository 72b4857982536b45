"""Vehicles that say anything at all: the bridge never ends, the others are served, and so is who is repaired.

`poe vehicles` sends 10,000 messages with each database; the suite some of them.
"""

from __future__ import annotations

import json
import random
import secrets
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from pydantic import SecretStr

from service.settings import Settings
from tests.patience import soon
from tests.server import Server, running
from tests.service.asking import ok
from tests.worker.bridges import Plant, bridging
from tests.worker.vehicle_fuzz import broken
from tests.worker.vehicles import PlainVehicle, mosquitto
from worker.vda5050.messages import online_version, read_state
from worker.vda5050.schema import NoState

VERSIONS = ("2.1.0", "3.0.0")
LOOK_S = 0.5
SERVED_S = REPAIRED_S = 60.0


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[int]:
    with mosquitto(tmp_path) as port:
        yield port


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def served(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Server]:
    url = SecretStr(request.getfixturevalue("postgres_url")) if request.param == "postgres" else None
    with running(Settings(data_dir=tmp_path / "data", database_url=url)) as server:
        yield server


@pytest.mark.parametrize("seed", range(1, 9))
def test_any_bytes_are_read_or_refused(seed: int) -> None:
    """Whatever a vehicle sends is what the schema says or a `NoState`, in both versions."""
    rng, kinds = random.Random(seed), Counter[str]()
    vehicle = PlainVehicle.__new__(PlainVehicle)
    for k in range(500):
        vehicle.__dict__.update(serial_number="1", is_driving=False, _version=VERSIONS[k % 2], _header=k)
        vehicle.__dict__.update(_maps={("map_1", "1"): "ENABLED"}, _states={"a": {"actionStatus": "FAILED"}})
        subtopic, payload = broken(vehicle.state(), rng)
        try:
            (read_state if subtopic == "state" else online_version)(payload)
            kinds["read"] += 1
        except NoState as refusal:
            str(refusal).encode()
            kinds["refused"] += 1
    assert min(kinds["read"], kinds["refused"]) > 100, kinds


@pytest.mark.parametrize(
    ("hostile", "rounds", "seed"),
    [
        pytest.param(6, 30, 1, id="some"),
        pytest.param(20, 250, 2, id="5000-seed-2", marks=pytest.mark.vehicles),
        pytest.param(20, 250, None, id="5000-random-seed", marks=pytest.mark.vehicles),
    ],
)
@pytest.mark.timeout(1800)
def test_vehicles_that_say_anything_harm_no_other(
    served: Server, broker: int, hostile: int, rounds: int, seed: int | None
) -> None:
    seed = secrets.randbits(32) if seed is None else seed
    print(f"\nseed {seed}: {hostile * rounds} messages of {hostile} vehicles")  # noqa: T201
    rng, plant = random.Random(seed), Plant(served, revisions=4)
    bad = [PlainVehicle(broker, f"bad-{k}-{plant.map_id}", VERSIONS[k % 2]) for k in range(hostile)]
    good = [PlainVehicle(broker, f"good-{version}-{plant.map_id}", version) for version in VERSIONS]
    for vehicle in (*bad, *good):
        plant.enrol(vehicle.serial_number)
    try:
        with bridging(served, broker) as process:
            plant.publish(1)
            kinds, slowest = Counter[str](), 0.0
            for k in range(rounds):
                begun = time.monotonic()
                for vehicle in bad:
                    subtopic, payload = broken(vehicle.state(), rng)
                    kinds[_kind(subtopic, payload)] += 1
                    vehicle.say(subtopic, payload)
                if k % 25 == 0:
                    n = 2 + (k // 25) % 2
                    plant.publish(n)
                    slowest = max(slowest, *(_served_after(plant, vehicle, n) for vehicle in good))
                    _lists_answer(plant)
                assert process.poll() is None, "the bridge has ended"
                time.sleep(max(0.0, begun + LOOK_S - time.monotonic()))
            told = sum(plant.robot(vehicle.serial_number)["remark"] is not None for vehicle in bad)
            for vehicle in bad:
                vehicle.tell()
            plant.publish(4)
            repaired = max(_served_after(plant, vehicle, 4) for vehicle in (*bad, *good))
            for vehicle in (*bad, *good):
                plant.until(vehicle.serial_number, patience_s=REPAIRED_S, remark=None)
                assert vehicle.maps()["4"] == "ENABLED"
            assert all(robot["remark"] is None for robot in _lists_answer(plant))
    finally:
        for vehicle in (*bad, *good):
            vehicle.close()
    print(f"{dict(kinds)}; {told} of {hostile} told at the end of it")  # noqa: T201
    print(f"others served within {slowest:.1f} s, the repaired within {repaired:.1f} s")  # noqa: T201
    assert slowest <= SERVED_S
    assert repaired <= REPAIRED_S
    assert told > 0


def _kind(subtopic: str, payload: bytes) -> str:
    try:
        (read_state if subtopic == "state" else online_version)(payload)
    except NoState:
        return "refused"
    return "read"


def _served_after(plant: Plant, vehicle: PlainVehicle, n: int) -> float:
    """Return how long it took until a vehicle runs a revision, by its own word and by the service's."""
    begun = time.monotonic()
    plant.until(vehicle.serial_number, patience_s=SERVED_S, enabled_revision=n)
    soon(
        lambda: vehicle.maps().get(str(n)) == "ENABLED",
        lambda: json.dumps(vehicle.state())[:500],
        patience_s=SERVED_S,
    )
    return time.monotonic() - begun


def _lists_answer(plant: Plant) -> list[dict[str, object]]:
    """Return all robots; every list that shows them and what they said has to answer."""
    robots: list[dict[str, object]] = ok(plant.admin.get("/v1/robots?limit=100"))["items"]
    for robot in robots:
        ok(plant.admin.get(f"/v1/robots/{robot['id']}"))
        ok(plant.admin.get(f"/v1/robots/{robot['id']}/reports"))
    ok(plant.admin.get("/v1/convergence"))
    return robots
