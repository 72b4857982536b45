"""A database without room: the bridge waits for it, and serves each vehicle all the while."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import event
from sqlalchemy.exc import OperationalError

from service.domain.errors import StorageFull
from service.settings import Settings
from service.usecases.kernel import Kernel
from tests.server import running
from tests.worker.bridges import Plant
from tests.worker.vehicle_messages import MAKER, a_message
from worker.vda5050.bridge import Bridge
from worker.vda5050.turn import Turn


@contextmanager
def no_room(kernel: Kernel) -> Iterator[None]:
    """Let the database refuse every change as SQLite does on a full disk."""

    def refuse(_connection: Any, _cursor: Any, statement: str, *_more: Any) -> None:
        if statement.startswith(("INSERT", "UPDATE", "DELETE")):
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode = sqlite3.SQLITE_FULL
            raise OperationalError(statement, None, error)

    event.listen(kernel.db.engine, "before_cursor_execute", refuse)
    try:
        yield
    finally:
        event.remove(kernel.db.engine, "before_cursor_execute", refuse)


def test_a_full_disk_keeps_no_vehicle_from_its_map(tmp_path: Path) -> None:
    sent: list[tuple[str, dict[str, Any]]] = []
    with running(Settings(data_dir=tmp_path)) as server:
        plant, kernel = Plant(server, revisions=2), server.kernel
        bridge = Bridge(
            kernel, send=lambda topic, payload: sent.append((topic, json.loads(payload))), base_url="http://x"
        )
        for name in ("first", "second", "third"):
            plant.enrol(name)
        plant.publish(1)

        def hear(name: str, **more: Any) -> None:
            bridge.hear(f"uagv/v2/{MAKER}/{name}/state", json.dumps(a_message(**more)).encode())

        with no_room(kernel):
            with pytest.raises(StorageFull), kernel.db.writing("probe") as session:
                session.connection().exec_driver_sql("DELETE FROM leases")
            foreign = {"mapId": plant.map_id, "mapVersion": "beta", "mapStatus": "ENABLED"}
            ours = {"mapId": plant.map_id, "mapVersion": "1", "mapStatus": "ENABLED"}
            hear("first", maps=[foreign])
            hear("second", maps=[ours])
            hear("third")
            bridge.look()
            bridge.look()
        asked = {topic.split("/")[3] for topic, _ in sent}
        assert "third" in asked, "what one vehicle has to be remembered for keeps no other waiting"
        assert plant.robot("second")["enabled_revision"] is None
        bridge.look()
        assert plant.robot("second")["enabled_revision"] == 1
        assert "beta" in plant.robot("first")["remark"]


def test_a_turn_outlives_a_database_without_room(tmp_path: Path) -> None:
    now = [0.0]
    with running(Settings(data_dir=tmp_path)) as server:
        turn = Turn(server.kernel, holder="a", lease_s=10.0, beat_s=3.0, clock=lambda: now[0])
        with no_room(server.kernel):
            assert not turn.is_ours()
        now[0] = 3.0
        assert turn.is_ours()
        with no_room(server.kernel):
            now[0] = 12.9
            assert turn.is_ours(), "the right that it has lasts as long as it would"
            now[0] = 13.0
            assert not turn.is_ours()
        now[0] = 16.0
        assert turn.is_ours()


def test_the_right_runs_while_the_database_lets_wait(tmp_path: Path) -> None:
    now, waits_s = [0.0], [0.0]
    with running(Settings(data_dir=tmp_path)) as server:

        def wait(*_: Any) -> None:
            now[0], waits_s[0] = now[0] + waits_s[0], 0.0

        event.listen(server.kernel.db.engine, "before_cursor_execute", wait)
        turn = Turn(server.kernel, holder="a", lease_s=10.0, beat_s=3.0, clock=lambda: now[0])
        assert turn.is_ours()
        now[0], waits_s[0] = 9.0, 15.0
        assert not turn.is_ours(), "asked at 9, answered at 24: the lease of 10 s is over"
        assert turn.is_ours()
        with no_room(server.kernel):
            now[0], waits_s[0] = 33.0, 1.5
            assert not turn.is_ours(), "it ran out during a call that failed"
