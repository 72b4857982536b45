"""Maps for vehicles that speak VDA 5050: a real broker, the real process, vehicles of 2.1 and 3.0."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr
from vda5050.validation import SchemaValidator

from service.settings import Settings
from tests.patience import PATIENCE_S, soon
from tests.server import Server, running
from tests.service.asking import refused
from tests.worker.bridges import Plant, bridging, packaged
from tests.worker.vehicle_messages import MAKER
from tests.worker.vehicles import (
    Overhearing,
    PackageVehicle,
    PlainVehicle,
    VehicleInTest,
    mosquitto,
)


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


def test_a_vehicle_fetches_uses_and_drops_revisions(
    case: tuple[Server, Callable[[int, str], VehicleInTest]], broker: int
) -> None:
    served, kind = case
    plant = Plant(served, revisions=4)
    name = f"AMR-{plant.map_id[-8:]}"
    plant.enrol(name)
    refused(plant.try_to_enrol(name), 409, "vehicle-taken")
    overheard, vehicle = Overhearing(broker), kind(broker, name)
    try:
        with bridging(served, broker):
            plant.publish(1)
            plant.until(name, enabled_revision=1, progress="up-to-date")
            plant.publish(2)
            plant.until(name, enabled_revision=2, progress="up-to-date")
            assert vehicle.maps() == {"1": "DISABLED", "2": "ENABLED"}
        plant.publish(3)
        with bridging(served, broker):
            plant.until(name, enabled_revision=3)
            soon(lambda: vehicle.maps() == {"2": "DISABLED", "3": "ENABLED"}, patience_s=PATIENCE_S)
            vehicle.excuse = "the hash does not match"
            plant.publish(4)
            failed = plant.until(name, state="failed", reported_revision=4)
            assert (failed["detail"], failed["enabled_revision"]) == (vehicle.excuse, 3)
            vehicle.excuse = None
            plant.publish(2)
            plant.until(name, enabled_revision=2, progress="up-to-date", remark=None)
    finally:
        vehicle.close()
        overheard.close()
    assert vehicle.fetched == [packaged(1), packaged(2), packaged(3)], "2 was still there to go back to"
    assert [report[:2] for report in plant.reports(name) if report[1] != "downloaded"] == [
        (1, "enabled"),
        (2, "enabled"),
        (3, "enabled"),
        (4, "failed"),
        (2, "enabled"),
    ]
    _check_messages(overheard.messages, name, kind)


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
