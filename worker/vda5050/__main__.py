"""The process of `groundplan vda5050`: read the settings, stay with the broker, look twice a second."""

from __future__ import annotations

import argparse
import os
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from urllib.parse import SplitResult, unquote, urlsplit

import structlog
from paho.mqtt.client import Client, ConnectFlags, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from pydantic import ValidationError

from service import crash_points, logs
from service.db.session import Database, open_engine
from service.domain.errors import Unavailable
from service.settings import Settings
from service.storage.local import LocalBlobStore
from service.usecases.kernel import Kernel
from service.usecases.readiness import why_not_started
from worker.vda5050.bridge import Bridge
from worker.vda5050.turn import Turn

_LOOK_EVERY_S = 0.5
_PORTS = {"mqtt": 1883, "mqtts": 8883}
_AT_LEAST_ONCE = 1
_CLIENT = "groundplan-"
"""How the client id begins; with 12 digits it has the 23 characters that every broker takes (MQTT 3.1.1)."""

log = structlog.get_logger(__name__)


def main(argv: list[str] | None = None) -> int:
    """Bridge until told to stop, and return the exit status: 0 then, 1 refused (with one line why)."""
    argparse.ArgumentParser(
        prog="python -m worker.vda5050",
        description="Bring maps to robots that speak VDA 5050, until SIGTERM or SIGINT. Settings come from "
        "the environment (GROUNDPLAN_...); `groundplan vda5050` takes the folder of files as an option.",
    ).parse_args(argv)
    try:
        settings = Settings()
        url = settings.url()
    except ValidationError as error:
        first = error.errors()[0]
        return _refuse(f"the setting {'.'.join(map(str, first['loc']))}: {first['msg']}")
    except OSError as error:
        return _refuse(str(error))
    if settings.mqtt_url is None or settings.public_url is None:
        return _refuse("set GROUNDPLAN_MQTT_URL, and GROUNDPLAN_PUBLIC_URL, where vehicles fetch their maps")
    broker = urlsplit(settings.mqtt_url.get_secret_value())
    if broker.scheme not in _PORTS or not broker.hostname:
        return _refuse("GROUNDPLAN_MQTT_URL has to be mqtt://host[:port] or mqtts://host[:port]")
    logs.configure(level=settings.log_level)
    crash_points.arm_from(settings.crash_at, folder=settings.data_dir)
    kernel = Kernel(
        db=Database(open_engine(url)),
        blobs=LocalBlobStore(settings.data_dir),
        now=lambda: datetime.now(UTC),
        entropy=secrets.token_bytes,
    )
    if why := why_not_started(kernel):
        return _refuse(why)
    process = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
    turn = Turn(kernel, holder=process, lease_s=settings.lease_s, beat_s=settings.beat_s)
    stopping = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _signal, _frame: stopping.set())
    try:
        while not stopping.wait(_LOOK_EVERY_S):
            if turn.is_ours():
                with _connected(broker, settings.mqtt_interface, kernel, settings.public_url) as (
                    client,
                    bridge,
                ):
                    _look_until(stopping, turn, client, bridge)
    finally:
        with suppress(Unavailable):
            turn.end()
        kernel.db.close()
    return 0


@contextmanager
def _connected(
    broker: SplitResult, interface: str, kernel: Kernel, base_url: str
) -> Iterator[tuple[Client, Bridge]]:
    """Give a bridge that hears the vehicles, under a name on the broker that no other process has."""
    client = Client(CallbackAPIVersion.VERSION2, client_id=f"{_CLIENT}{secrets.token_hex(6)}")
    bridge = Bridge(kernel, send=lambda topic, payload: _send(client, topic, payload), base_url=base_url)
    _listen(client, bridge, interface=interface)
    if broker.username:
        client.username_pw_set(unquote(broker.username), unquote(broker.password or ""))
    if broker.scheme == "mqtts":
        client.tls_set()
    client.reconnect_delay_set(min_delay=1, max_delay=30)
    client.connect_async(broker.hostname or "", broker.port or _PORTS[broker.scheme])
    client.loop_start()
    try:
        yield client, bridge
    finally:
        client.disconnect()
        client.loop_stop()


def _look_until(stopping: threading.Event, turn: Turn, client: Client, bridge: Bridge) -> None:
    """Look while it is this process's turn; without the broker nothing is asked, so that nothing piles up."""
    while not stopping.wait(_LOOK_EVERY_S):
        if not turn.is_ours():
            log.warning("the right to be the active bridge is lost")
            return
        if not client.is_connected():
            continue
        try:
            bridge.look()
        except Unavailable as error:
            log.warning("the database did not answer", why=error.detail)


def _listen(client: Client, bridge: Bridge, *, interface: str) -> None:
    """Let the bridge hear every vehicle of the interface, whatever version it speaks."""

    def connected(
        _client: Client, _data: object, _flags: ConnectFlags, reason: ReasonCode, _more: Properties | None
    ) -> None:
        if reason.is_failure:
            log.warning("the broker refuses", reason=str(reason))
            return
        log.info("connected to the broker")
        client.subscribe([(f"{interface}/+/+/+/{name}", _AT_LEAST_ONCE) for name in ("state", "connection")])

    def heard(_client: Client, _data: object, message: MQTTMessage) -> None:
        try:
            bridge.hear(message.topic, bytes(message.payload))
        except Exception:
            log.exception("a message cannot be taken")

    client.on_connect = connected
    client.on_message = heard


def _send(client: Client, topic: str, payload: bytes) -> None:
    client.publish(topic, payload, qos=_AT_LEAST_ONCE)


def _refuse(why: str) -> int:
    sys.stderr.write(f"groundplan vda5050: {why}\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
