"""Vehicles that speak VDA 5050 on a real broker: one of an independent package (2.1), one by hand (3.0)."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import shutil
import socket
import subprocess
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import pytest
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion
from vda5050.client.agv.client import VehicleClient
from vda5050.config import VehicleConfig
from vda5050.model.common import Action
from vda5050.model.enums import ActionStatus, MapStatus
from vda5050.model.state import Map

from tests.patience import PATIENCE_S
from tests.worker.vehicle_messages import MAKER, a_connection, a_message


class VehicleInTest(Protocol):
    """A vehicle: what it has fetched, and a sentence with which it fails the next action."""

    serial_number: str
    fetched: list[bytes]
    excuse: str | None

    def maps(self) -> dict[str, str]:
        """Return the status of each version of the map that it has."""

    def close(self) -> None:
        """Leave the broker."""


def fetch(parameters: dict[str, Any]) -> bytes:
    """Return the map behind a link, which has to be the one that the hash names."""
    with urllib.request.urlopen(parameters["mapDownloadLink"], timeout=20) as answer:  # noqa: S310 - ours
        content: bytes = answer.read()
    if parameters["mapHash"] != f"sha256:{hashlib.sha256(content).hexdigest()}":
        msg = "the hash does not match"
        raise ValueError(msg)
    return content


class PackageVehicle:
    """A vehicle of `vda5050-sdk`, which speaks 2.1; its event loop runs in a thread of its own."""

    def __init__(self, port: int, serial_number: str) -> None:
        self.serial_number, self.fetched, self.excuse = serial_number, [], None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()
        config = VehicleConfig(
            broker_url=f"mqtt://127.0.0.1:{port}",
            manufacturer=MAKER,
            serial_number=serial_number,
            validate_messages=True,
        )
        self.client = VehicleClient(config)
        for name in ("downloadMap", "enableMap", "deleteMap"):
            self.client.register_action_handler(name, self._act)
        self._wait(self.client.connect())
        self._wait(self.client.publish_state())

    def _wait(self, coroutine: Any) -> None:
        asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(timeout=PATIENCE_S)

    def maps(self) -> dict[str, str]:
        """Return the status of each version of the map that it has."""
        return {m.map_version: m.map_status.value for m in self.client.publisher.maps}

    def close(self) -> None:
        """Leave the broker."""
        self._wait(self.client.disconnect())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _act(self, action: Action) -> None:
        publisher = self.client.publisher
        told = {p.key: p.value for p in action.action_parameters or []}
        if self.excuse is not None:
            self.client.report_action(
                action.action_id,
                ActionStatus.FAILED,
                action_type=action.action_type,
                result_description=self.excuse,
            )
            return
        others = [m for m in publisher.maps if m.map_version != told["mapVersion"]]
        if action.action_type == "downloadMap":
            self.fetched.append(await asyncio.to_thread(fetch, told))
            new = Map(map_id=told["mapId"], map_version=told["mapVersion"], map_status=MapStatus.DISABLED)
            publisher.set_maps([*others, new])
        elif action.action_type == "deleteMap":
            publisher.set_maps(others)
        else:
            publisher.enable_map(told["mapId"], told["mapVersion"])
        self.client.report_action(action.action_id, ActionStatus.FINISHED, action_type=action.action_type)


class PlainVehicle:
    """A vehicle written by hand, by default of 3.0: instant actions have states of their own there.

    It says what it does; `tell` may be given another way to say it.
    """

    def __init__(self, port: int, serial_number: str, version: str = "3.0.0") -> None:
        self.serial_number, self.fetched, self.excuse = serial_number, [], None
        self.is_driving = False
        self.topic = f"uagv/v{version[0]}/{MAKER}/{serial_number}"
        self._version = version
        self._maps: dict[tuple[str, str], str] = {}
        self._states: dict[str, dict[str, str]] = {}
        self._header = 0
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_message = self._heard
        self._client.connect("127.0.0.1", port)
        self._client.subscribe(f"{self.topic}/instantActions", qos=1)
        self._client.loop_start()
        self.say("connection", json.dumps(a_connection(version)).encode(), retain=True)

    def maps(self) -> dict[str, str]:
        """Return the status of each version of the map that it has."""
        return {version: status for (_, version), status in self._maps.items()}

    def close(self) -> None:
        """Leave the broker."""
        self._client.disconnect()
        self._client.loop_stop()

    def say(self, subtopic: str, payload: bytes, *, retain: bool = False) -> None:
        """Send any bytes."""
        self._client.publish(f"{self.topic}/{subtopic}", payload, qos=1, retain=retain)

    def remember(self, action_id: str, **state: str) -> None:
        """Have the state of an action that was asked for some time ago."""
        self._states[action_id] = state

    def state(self) -> dict[str, Any]:
        """Return what it would say now."""
        self._header += 1
        key = "instantActionStates" if self._version[0] == "3" else "actionStates"
        return a_message(
            self._version,
            headerId=self._header,
            serialNumber=self.serial_number,
            driving=self.is_driving,
            maps=[
                {"mapId": map_id, "mapVersion": version, "mapStatus": status}
                for (map_id, version), status in list(self._maps.items())
            ],
            **{key: [{"actionId": k, **v} for k, v in list(self._states.items())]},
        )

    def tell(self) -> None:
        """Say how it is."""
        self.say("state", json.dumps(self.state()).encode())

    def _heard(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        for action in json.loads(message.payload)["actions"]:
            self._act(action)
        self.tell()

    def _act(self, action: dict[str, Any]) -> None:
        told = {p["key"]: p["value"] for p in action["actionParameters"]}
        if action["actionType"] == "stateRequest":
            return
        state = self._states[action["actionId"]] = {"actionStatus": "FINISHED"}
        key = told["mapId"], told["mapVersion"]
        if self.excuse is not None:
            words = "actionResult" if self._version[0] == "3" else "resultDescription"
            state |= {"actionStatus": "FAILED", words: self.excuse}
        elif action["actionType"] == "downloadMap":
            self.fetched.append(fetch(told))
            self._maps[key] = "DISABLED"
        elif action["actionType"] == "deleteMap":
            self._maps.pop(key, None)  # it may have lied, or lost it
        else:
            self._maps = dict.fromkeys(self._maps, "DISABLED") | {key: "ENABLED"}


class Overhearing:
    """Keep every message that is sent to a vehicle."""

    def __init__(self, port: int) -> None:
        self.messages: list[dict[str, Any]] = []
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_message = lambda _c, _d, message: self.messages.append(json.loads(message.payload))
        self._client.connect("127.0.0.1", port)
        self._client.subscribe("uagv/+/+/+/instantActions", qos=1)
        self._client.loop_start()

    def actions(self) -> list[dict[str, Any]]:
        """Return what was asked for."""
        return [action for message in list(self.messages) for action in message["actions"]]

    def close(self) -> None:
        """Leave the broker."""
        self._client.disconnect()
        self._client.loop_stop()


@contextmanager
def mosquitto(folder: Path) -> Iterator[int]:
    """Run a broker, and give its port; the test is skipped where there is no program, but for CI."""
    program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin")
    if program is None:
        assert not os.environ.get("CI"), "mosquitto is not installed: run tools/setup --tests"
        pytest.skip("mosquitto is not installed: run tools/setup --tests")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    settings = folder / "mosquitto.conf"
    settings.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\nuser root\n")
    with (folder / "mosquitto.log").open("wb") as log:
        process = subprocess.Popen([program, "-c", str(settings)], stdout=log, stderr=log)
    try:
        until = time.monotonic() + PATIENCE_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", port), timeout=1).close()
                break
            except OSError:
                assert process.poll() is None, (folder / "mosquitto.log").read_text()
                assert time.monotonic() < until
                time.sleep(0.05)
        yield port
    finally:
        process.terminate()
        process.wait()
