"""Whatever text comes out of a file or from a client: it is stored, and every list still answers."""

from __future__ import annotations

import importlib
import pkgutil
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import JSON, Column, String, Table, func, select, update

import service.db
from service.db.models import Base
from service.db.webhooks import WebhookDelivery
from service.settings import Settings
from tests.postgres import PostgresServer
from tests.server import Server, running
from tests.service.asking import a_map, a_placement, a_ready_revision, ok
from tests.service.by_hand import ByHand

for _module in pkgutil.iter_modules(service.db.__path__):
    importlib.import_module(f"service.db.{_module.name}")

NASTY = "\ud800 \udcb0 \x00 \x1b[2J \x9b"
ANY_TEXT = st.text(alphabet=st.characters(), min_size=1, max_size=40)
Put = Callable[[str], Any]


def _as_it_is(text: str) -> Any:
    return text


def _inside(**more: Any) -> Put:
    return lambda text: {
        "detail": text,
        text: [text, {"n": float("nan"), "huge": 10**30}],
        "findings": [{"code": "told", "severity": "warning", "message": text, "members": {"layer": text}}],
        **more,
    }


TOLD: dict[str, Put] = {
    "answers.body": _as_it_is,
    "answers.headers": _inside(),
    "audit.after": _inside(),
    "audit.before": _inside(),
    "comparisons.geometry": _inside(),
    "drawings.file_name": _as_it_is,
    "drawings.reading": _inside(scale={"state": "unknown"}),
    "jobs.problem": _inside(slug="file-malformed", title="The file cannot be read"),
    "jobs.stage": _as_it_is,
    "jobs.worker": _as_it_is,
    "keys.name": _as_it_is,
    "layers.name": _as_it_is,
    "maps.name": _as_it_is,
    "placements.evidence": _inside(),
    "placements.reasons": lambda text: [text],
    "proposals.evidence": _inside(),
    "publications.reason": _as_it_is,
    "revisions.reason": _as_it_is,
    "revisions.report": _inside(),
    "robot_reports.detail": _as_it_is,
    "robots.detail": _as_it_is,
    "robots.manufacturer": _as_it_is,
    "robots.name": _as_it_is,
    "robots.serial_number": _as_it_is,
    "rollout_steps.detail": _as_it_is,
    "rollouts.override": _as_it_is,
    "rollouts.reason": _as_it_is,
    "scans.file_name": _as_it_is,
    "scans.reading": _inside(),
    "uploads.meta": _inside(),
    "webhook_deliveries.tries": lambda text: [
        {"at": "2026-01-01T00:00:00Z", "status": None, "error": text, "seconds": 0.1}
    ],
    "webhook_events.told": _inside(),
}
"""Columns of what files, robots, clients or libraries told, and for each a value that holds a text."""

OURS = {
    "answers.request_sha256", "artifacts.media_type", "audit.action", "audit.subject_id", "blobs.media_type",
    "deltas.coded_sha256", "deltas.from_sha256", "deltas.to_sha256", "drawings.options", "exports.format",
    "jobs.attempt_token", "jobs.kind", "jobs.state", "jobs.subject_id", "keys.digest", "keys.map_ids",
    "keys.role", "layers.layer_id", "layers.part", "layers.t_map_scan", "maps.site", "placements.candidates",
    "placements.initial_pose", "placements.t_map_scan", "placements.verdict", "proposals.layer_id",
    "proposals.state", "publications.channel", "publications.overridden", "revisions.artifacts_sha256",
    "revisions.erased", "revisions.operations", "revisions.recipe", "revisions.scale",
    "revisions.software_version", "revisions.status", "robot_reports.sha256", "robot_reports.state",
    "robots.channel", "robots.group_name", "robots.state", "rollout_steps.kind", "rollouts.bound",
    "rollouts.channel", "rollouts.overridden", "rollouts.stages", "rollouts.state", "scans.options",
    "scans.rough_pose", "uploads.result", "webhook_deliveries.body", "webhook_deliveries.event",
    "webhook_deliveries.state", "webhook_events.kind", "webhooks.events", "webhooks.map_ids",
    "webhooks.old_secret", "webhooks.secret", "webhooks.url",
}  # fmt: skip
"""Columns whose values the product makes itself, or has checked against a pattern or a form."""


def _text_columns() -> Iterator[tuple[str, Table, Column[Any]]]:
    for table in Base.metadata.sorted_tables:
        for column in table.columns:
            is_text = isinstance(column.type, String | JSON)
            if is_text and not column.foreign_keys and not column.primary_key:
                yield f"{table.name}.{column.name}", table, column


def test_every_column_of_text_is_in_one_of_the_two_lists() -> None:
    assert {name for name, _, _ in _text_columns()} == set(TOLD) | OURS
    assert not set(TOLD) & OURS


@dataclass(frozen=True)
class Plant:
    """Hold a service with a row of every kind, and where they are listed."""

    server: Server
    admin: httpx.Client
    lists: tuple[str, ...]

    def look(self) -> None:
        """Ask for every list and every thing; each has to answer."""
        for path in self.lists:
            answer = self.admin.get(path)
            assert answer.status_code == 200, (path, answer.text)
            answer.json()

    def store(self, text: str, *, only: str | None = None) -> dict[str, int]:
        """Store a text in every column that is told from outside; return how many rows took it."""
        counts = {}
        with self.server.kernel.db.writing("change-map") as session:
            for name, table, column in _text_columns():
                if name not in TOLD or only not in {None, name}:
                    continue
                given = text[: column.type.length] if isinstance(column.type, String) else text
                key = table.primary_key.columns[0]
                change = update(table).values({column: TOLD[name](given)})
                if name in {"maps.name", "robots.serial_number"}:  # unique: one row takes it
                    change = change.where(key == select(func.min(key)).scalar_subquery())
                counts[name] = session.execute(change).rowcount  # type: ignore[attr-defined]
        return counts


def _planted(server: Server) -> Plant:
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    drawing_id = by_hand.drawing(map_id)
    scan_id = by_hand.scan(map_id)
    a_ready_revision(admin, by_hand, map_id)
    placement_id = a_placement(admin, by_hand, map_id)
    revised = admin.post(f"/v1/placements/{placement_id}/accept", json={})
    by_hand.build(ok(revised, 202)["job"]["id"])
    ok(admin.post(f"/v1/maps/{map_id}/revisions/1/publish", json={"reason": "told"}))
    robot = ok(admin.post("/v1/robots", json={"name": "AMR", "map_id": map_id}), 201)
    said = {"state": "failed", "revision": 1, "detail": "told"}
    ok(server.client(robot["key"]).post(f"/v1/robots/{robot['id']}/reports", json=said), 201)
    stages = {"revision": 2, "stages": [{"share": 1.0}]}
    rollout = ok(admin.post(f"/v1/maps/{map_id}/rollouts", json=stages), 201)
    hook = {"url": "https://example.com/hook", "events": ["job.failed"]}
    webhook = ok(admin.post("/v1/webhooks", json=hook), 201)
    _deliver(server, map_id, webhook["id"])
    failed = by_hand.drawing(map_id, read=False)
    job = ok(admin.get(f"/v1/drawings/{failed}"))["job"]["id"]
    by_hand.fail(job, problem={"slug": "file-malformed", "title": "t", "detail": "d"})
    in_map, things = f"/v1/maps/{map_id}", [f"/v1/drawings/{drawing_id}", f"/v1/drawings/{failed}"]
    lists = (
        *("/v1/audit", "/v1/drawings", "/v1/jobs", "/v1/keys", "/v1/maps", "/v1/placements", "/v1/proposals"),
        *("/v1/revisions", "/v1/robots", "/v1/scans", "/v1/stats", "/v1/webhooks", "/v1/convergence", in_map),
        *(f"{in_map}/{name}" for name in ("channels", "drawings", "proposals", "publications", "published")),
        *(f"{in_map}/{name}" for name in ("revisions", "rollouts", "scans", "revisions/1", "revisions/2")),
        *(f"{in_map}/revisions/2/{name}" for name in ("artifacts", "gates")),
        *(f"/v1/scans/{scan_id}", f"/v1/jobs/{job}", f"/v1/placements/{placement_id}", *things),
        *(f"/v1/robots/{robot['id']}", f"/v1/robots/{robot['id']}/reports"),
        *(f"/v1/rollouts/{rollout['id']}", f"/v1/rollouts/{rollout['id']}/robots"),
        *(f"/v1/webhooks/{webhook['id']}", f"/v1/webhooks/{webhook['id']}/deliveries"),
    )
    return Plant(server, admin, lists)


def _deliver(server: Server, map_id: str, webhook_id: str) -> None:
    kernel = server.kernel
    with kernel.db.writing("dispatch-webhooks") as session:
        now = kernel.now()
        session.add(
            WebhookDelivery(
                id=kernel.new_id("del"),
                webhook_id=webhook_id,
                map_id=map_id,
                event="job.failed",
                body="{}",
                state="failed",
                tries=[],
                try_at=now,
                created_at=now,
                ended_at=now,
            )
        )


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def plant(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Plant]:
    folder: Path = tmp_path_factory.mktemp("poisoned")
    if request.param == "sqlite":
        with running(Settings(data_dir=folder)) as server:
            yield _planted(server)
        return
    cluster: PostgresServer = request.getfixturevalue("postgres_server")
    with (
        cluster.database() as url,
        running(Settings(data_dir=folder, database_url=url)) as server,  # type: ignore[arg-type]
    ):
        yield _planted(server)


def test_a_nasty_text_in_any_column_leaves_every_list_as_it_was(plant: Plant) -> None:
    plant.look()
    counts = plant.store(NASTY)
    plant.look()
    rare = {"answers.body", "answers.headers", "comparisons.geometry", "uploads.meta", "webhook_events.told"}
    assert {name for name, count in counts.items() if count == 0} <= rare | {"proposals.evidence"}


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=ANY_TEXT)
def test_any_text_in_every_column_leaves_every_list_answering(plant: Plant, text: str) -> None:
    plant.store(text)
    plant.look()


def test_what_is_looked_for_is_made_plain_like_what_is_stored(plant: Plant) -> None:
    plant.store("na\x1bsty.dxf", only="drawings.file_name")
    found = ok(plant.admin.get("/v1/drawings", params={"q": "na\x1bsty"}))["items"]
    assert {one["file_name"] for one in found} == {"na\N{REPLACEMENT CHARACTER}sty.dxf"}


def test_what_an_earlier_version_stored_does_not_end_a_list(tmp_path: Path) -> None:
    with running(Settings(data_dir=tmp_path)) as server:
        plant = _planted(server)
        poison = (
            r'{"slug": "file-malformed", "title": "t", "detail": "\udcb0 \u0000", "n": NaN, "k\ud800": 1}'
        )
        reading = (
            r'{"scale": {"state": "unknown"}, "findings": [{"code": "c", "message": "\ud800"}], "x": NaN}'
        )
        with sqlite3.connect(tmp_path / "groundplan.sqlite3") as raw:
            raw.execute("UPDATE jobs SET problem = ? WHERE state = 'failed'", (poison,))
            raw.execute("UPDATE drawings SET reading = ? WHERE reading IS NOT NULL", (reading,))
            raw.execute("UPDATE scans SET reading = ?", (reading,))
            raw.execute('UPDATE audit SET "after" = ?', (poison,))
        plant.look()
