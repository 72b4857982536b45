"""Whatever text comes out of a file or from a client: it is stored, and every list still answers."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import JSON, Column, String, Table, Update, create_engine, func, select, update

import service.db
from service.db import schema
from service.db.models import Base
from service.settings import Settings
from tests.every_list import look_everywhere
from tests.server import Server, running
from tests.service.asking import ok
from tests.service.plants import one_of_each

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
    "robots.remark": _as_it_is,
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
    "keys.role", "layers.layer_id", "layers.part", "layers.t_map_scan", "leases.holder", "maps.site",
    "placements.candidates",
    "placements.initial_pose", "placements.t_map_scan", "placements.verdict", "proposals.layer_id",
    "proposals.state", "publications.channel", "publications.overridden", "revisions.artifacts_sha256",
    "revisions.drawing_frame", "revisions.erased", "revisions.operations", "revisions.recipe",
    "revisions.scale",
    "revisions.software_version", "revisions.status", "robot_reports.sha256", "robot_reports.state",
    "robots.channel", "robots.group_name", "robots.state", "rollout_steps.kind", "rollouts.bound",
    "rollouts.channel", "rollouts.overridden", "rollouts.stages", "rollouts.state", "scans.options",
    "scans.rough_pose", "uploads.result", "webhook_deliveries.body", "webhook_deliveries.event",
    "webhook_deliveries.state", "webhook_events.kind", "webhooks.events", "webhooks.map_ids",
    "webhooks.old_secret", "webhooks.secret", "webhooks.url",
}  # fmt: skip
"""Columns whose values the product makes itself, or has checked against a pattern or a form."""


SELDOM = {
    "answers.body", "answers.headers", "comparisons.geometry", "proposals.evidence", "uploads.meta",
    "webhook_events.told",
}  # fmt: skip
"""Columns of rows that a plant does not have."""


def _text_columns() -> Iterator[tuple[str, Table, Column[Any]]]:
    for table in Base.metadata.sorted_tables:
        for column in table.columns:
            is_text = isinstance(column.type, String | JSON)
            if is_text and not column.foreign_keys and not column.primary_key:
                yield f"{table.name}.{column.name}", table, column


def test_every_column_of_text_is_in_one_of_the_two_lists() -> None:
    assert {name for name, _, _ in _text_columns()} == set(TOLD) | OURS
    assert not set(TOLD) & OURS


def _changes(text: str, *, only: str | None = None) -> Iterator[tuple[str, Update]]:
    """Give a statement for each column that is told from outside, which puts a text into it."""
    for name, table, column in _text_columns():
        if name in TOLD and only in {None, name}:
            given = text[: column.type.length] if isinstance(column.type, String) else text
            key = table.primary_key.columns[0]
            change = update(table).values({column: TOLD[name](given)})
            if name in {"maps.name", "robots.serial_number"}:  # unique: one row takes it
                change = change.where(key == select(func.min(key)).scalar_subquery())
            yield name, change


def store(server: Server, text: str, *, only: str | None = None) -> dict[str, int]:
    """Store a text in every column that is told from outside; return how many rows took it."""
    with server.kernel.db.writing("change-map") as session:
        changes = _changes(text, only=only)
        return {name: session.execute(change).rowcount for name, change in changes}  # type: ignore[attr-defined]


def test_a_nasty_text_in_any_column_leaves_every_list_as_it_was(planted: Server) -> None:
    look_everywhere(planted.client(planted.admin_key))
    counts = store(planted, NASTY)
    look_everywhere(planted.client(planted.admin_key))
    assert {name for name, count in counts.items() if count == 0} <= SELDOM


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=ANY_TEXT)
def test_any_text_in_every_column_leaves_every_list_answering(planted: Server, text: str) -> None:
    store(planted, text)
    look_everywhere(planted.client(planted.admin_key))


def test_what_is_looked_for_is_made_plain_like_what_is_stored(planted: Server) -> None:
    store(planted, "na\x1bsty.dxf", only="drawings.file_name")
    found = ok(planted.client(planted.admin_key).get("/v1/drawings", params={"q": "na\x1bsty"}))["items"]
    assert {one["file_name"] for one in found} == {"na\N{REPLACEMENT CHARACTER}sty.dxf"}


def test_what_an_earlier_version_stored_does_not_end_a_list(tmp_path: Path) -> None:
    """It had no key of a job, stored what `json.dumps` makes of anything, and texts as SQLite takes them."""
    with running(Settings(data_dir=tmp_path)) as server:
        one_of_each(server)
        json_of = {name for name, _, column in _text_columns() if isinstance(column.type, JSON)}
        with create_engine(server.settings.url()).begin() as before:
            for (name, of_json), (_, of_text) in zip(_changes(NASTY), _changes("a\x00\x1b[2J"), strict=True):
                before.execute(of_json if name in json_of else of_text)
        schema.downgrade(server.kernel.db.engine, to="0013")
        schema.upgrade(server.kernel.db.engine)
        look_everywhere(server.client(server.admin_key), is_plain=False)
