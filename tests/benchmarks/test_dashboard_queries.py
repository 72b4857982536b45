# ruff: noqa: S608, E501 - rows are made by the database itself, from numbers of this file
"""The dashboard's queries on PostgreSQL with a big plant's years in it: time, statements, and plans.

100,000 revisions of 200 maps, 10,000 robots, 1,000,000 jobs and as many audit entries, over a year.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from sqlalchemy import Connection, event, text

from service.app import open_kernel
from service.db.audit import AuditFilter
from service.db.narrowing import Narrowing
from service.db.robots import RobotFilter
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.settings import Settings
from service.usecases import audit, find, maps, publish, robots
from service.usecases.kernel import Kernel
from service.usecases.stats import Figures, WantedSeries, series

pytestmark = [pytest.mark.benchmark, pytest.mark.postgres]

MAPS, REVISIONS, ROBOTS, JOBS = 200, 100_000, 10_000, 1_000_000
ROUNDS = 40
MOST_MS = 50.0
MOST_STATEMENTS = 8
YEAR_S = 365 * 86400
BEGIN = datetime(2025, 11, 1, tzinfo=UTC)

FILL = """
CREATE FUNCTION pg_temp.made(prefix text, k bigint, total bigint) RETURNS text AS $$
  SELECT prefix || '_' || string_agg(substr('0123456789abcdefghjkmnpqrstvwxyz',
    ((((:begin_ms + (k * :year_ms / total)) >> (5 * (9 - d) - 2 + 2)) & 31) + 1)::int, 1), '' ORDER BY d)
    || lpad(k::text, 16, '0')
  FROM generate_series(0, 9) AS d
$$ LANGUAGE sql;
"""
"""Ids that sort by time: 10 characters of 5 bits each hold the milliseconds, then the row's number."""


def moment(total: int) -> str:
    return f"(timestamptz '{BEGIN.isoformat()}' + k * interval '{YEAR_S / total:.6f} seconds')"


def fill(connection: Connection) -> None:
    """Fill the tables by statements of the database itself: a year's rows in seconds."""
    made = FILL.replace(":begin_ms", str(int(BEGIN.timestamp() * 1000))).replace(
        ":year_ms", str(YEAR_S * 1000)
    )
    connection.execute(text(made))
    connection.execute(
        text(
            "INSERT INTO keys (id, name, role, digest, created_at) VALUES ('key_0', 'first', 'admin', 'd', now());"
        )
    )
    connection.execute(
        text(
            "INSERT INTO blobs (sha256, size_bytes, media_type, created_at) "
            "SELECT md5(k::text) || md5(k::text), 1000, 'application/json', now() FROM generate_series(0, 9999) k"
        )
    )
    connection.execute(
        text(
            "INSERT INTO maps (id, site, name, created_at, updated_at, next_revision) "
            f"SELECT 'map_' || k, 'site ' || k % 20, 'floor ' || k, now(), now(), {REVISIONS // MAPS + 1} "
            f"FROM generate_series(0, {MAPS - 1}) k"
        )
    )
    states = "(ARRAY['succeeded','succeeded','succeeded','succeeded','failed','cancelled'])[1 + k % 6]"
    kinds = "(ARRAY['read-drawing','read-scan','place-scan','build-revision','make-delta'])[1 + k % 5]"
    connection.execute(
        text(
            "INSERT INTO jobs (id, kind, map_id, subject_id, state, attempt, run_after, cancel_requested, "
            "fraction, created_at, ended_at, changed) "
            f"SELECT pg_temp.made('job', k, {JOBS}), {kinds}, 'map_' || k % {MAPS}, 'sub_' || k, "
            f"CASE WHEN k > {JOBS - 50} THEN 'queued' ELSE {states} END, 1, {moment(JOBS)}, false, 1.0, "
            f"{moment(JOBS)}, {moment(JOBS)}, 3 FROM generate_series(1, {JOBS}) k"
        )
    )
    connection.execute(
        text(
            "INSERT INTO drawings (id, map_id, file_name, blob_sha256, options, job_id, created_at, created_by) "
            "SELECT 'drw_' || m.id, m.id, 'hall.png', (SELECT min(sha256) FROM blobs), '{}', "
            "(SELECT min(id) FROM jobs), now(), 'key_0' FROM maps m"
        )
    )
    connection.execute(
        text(
            "INSERT INTO revisions (id, map_id, n, parent_n, status, recipe, drawing_id, walls_sha256, scale, "
            "job_id, report, created_at, created_by) "
            f"SELECT pg_temp.made('rev', k, {REVISIONS}), 'map_' || k % {MAPS}, 1 + k / {MAPS}, NULL, "
            "CASE WHEN k % 50 = 0 THEN 'failed' ELSE 'ready' END, '{}', 'drw_map_' || k % 200, "
            f"(SELECT min(sha256) FROM blobs), '{{}}', pg_temp.made('job', k * 10 + 10, {JOBS}), "
            f"'{{\"counts\": {{\"points\": 1000000}}}}', {moment(REVISIONS)}, 'key_0' "
            f"FROM generate_series(0, {REVISIONS - 1}) k WHERE k * 10 + 10 <= {JOBS}"
        )
    )
    connection.execute(
        text(
            "INSERT INTO channels (map_id, name, revision_n, generation, published_at) "
            f"SELECT id, 'stable', {REVISIONS // MAPS}, 1, now() FROM maps"
        )
    )
    connection.execute(
        text(
            "INSERT INTO keys (id, name, role, digest, created_at) "
            f"SELECT 'key_r' || k, 'robot', 'robot', 'd' || k, now() FROM generate_series(1, {ROBOTS}) k"
        )
    )
    connection.execute(
        text(
            "INSERT INTO robots (id, name, map_id, channel, group_name, key_id, created_at, enabled_n, state, "
            "reported_n, reported_at) "
            f"SELECT pg_temp.made('rob', k, {ROBOTS}), 'AMR ' || k, 'map_' || k % {MAPS}, 'stable', "
            f"'group ' || k % 5, 'key_r' || k, now(), {REVISIONS // MAPS} - (k % 10 = 0)::int, 'enabled', "
            f"{REVISIONS // MAPS}, now() FROM generate_series(1, {ROBOTS}) k"
        )
    )
    connection.execute(
        text(
            "INSERT INTO audit (id, at, key_id, action, map_id, subject_id) "
            f"SELECT pg_temp.made('aud', k, {JOBS}), {moment(JOBS)}, 'key_0', "
            "(ARRAY['revise','publish','receive-scan','place-scan'])[1 + k % 4], "
            f"'map_' || k % {MAPS}, 'sub_' || k FROM generate_series(1, {JOBS}) k"
        )
    )


@pytest.fixture(scope="module")
def plant(postgres_server: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Kernel]:
    """Give a kernel on a database with a year in it."""
    from service.db.schema import upgrade  # noqa: PLC0415 - only here

    with postgres_server.database() as url:
        kernel = open_kernel(Settings(data_dir=tmp_path_factory.mktemp("plant"), database_url=url))
        try:
            upgrade(kernel.db.engine)
            begun = time.monotonic()
            with kernel.db.engine.begin() as connection:
                fill(connection)
            with kernel.db.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
                connection.execute(text("VACUUM ANALYZE"))
            print(f"\nfilled in {time.monotonic() - begun:.0f} s")
            yield kernel
        finally:
            kernel.db.close()


def queries(kernel: Kernel) -> dict[str, Callable[[Any], object]]:
    """Return every query of the dashboard, by what it shows."""
    admin = Actor("key_0", Role.ADMIN)
    some = Actor("key_0", Role.ADMIN, frozenset({"map_3", "map_5"}))
    end = BEGIN + timedelta(seconds=YEAR_S)
    figures = Figures(kernel)

    def narrow(**more: Any) -> Narrowing:
        return Narrowing(limit=51, **more)

    halfway = BEGIN + timedelta(days=180)
    return {
        "maps, by text": lambda s: maps.list_maps(s, admin, site=None, text="floor 7", after=None, limit=51),
        "revisions, newest": lambda s: find.find_revisions(s, admin, narrow()),
        "revisions, failed": lambda s: find.find_revisions(s, admin, narrow(equals={"status": "failed"})),
        "revisions, of a map": lambda s: find.find_revisions(s, admin, narrow(equals={"map_id": "map_7"})),
        "revisions, from the middle": lambda s: find.find_revisions(s, admin, narrow(until=halfway)),
        "revisions, oldest first": lambda s: find.find_revisions(s, admin, narrow(newest_first=False)),
        "revisions, key of two maps": lambda s: find.find_revisions(s, some, narrow()),
        "jobs, newest": lambda s: find.find_jobs(s, admin, narrow()),
        "jobs, queued": lambda s: find.find_jobs(s, admin, narrow(equals={"state": "queued"})),
        "jobs, failed deltas": lambda s: find.find_jobs(
            s, admin, narrow(equals={"state": "failed", "kind": "make-delta"})
        ),
        "jobs, failed of a map": lambda s: find.find_jobs(
            s, admin, narrow(equals={"state": "failed", "map_id": "map_7"})
        ),
        "jobs, of a day": lambda s: find.find_jobs(
            s, admin, narrow(since=halfway, until=halfway + timedelta(days=1))
        ),
        "jobs, key of two maps": lambda s: find.find_jobs(s, some, narrow()),
        "robots": lambda s: robots.list_robots(s, admin, RobotFilter(), after=None, limit=51),
        "robots, behind": lambda s: robots.list_robots(
            s, admin, RobotFilter(behind=True), after=None, limit=51
        ),
        "robots, behind, of a map": lambda s: robots.list_robots(
            s, admin, RobotFilter(behind=True, map_id="map_7"), after=None, limit=51
        ),
        "audit, newest": lambda s: audit.list_entries(s, admin, AuditFilter(), before=None, limit=51),
        "audit, publications of a map": lambda s: audit.list_entries(
            s, admin, AuditFilter(map_id="map_7", action="publish"), before=None, limit=51
        ),
        "audit, of a thing": lambda s: audit.list_entries(
            s, admin, AuditFilter(subject_id="sub_77777"), before=None, limit=51
        ),
        "channels of a map": lambda s: publish.list_channels(s, admin, map_id="map_7"),
        "figures": lambda s: figures.stats(s, admin),
        "jobs a day, a month": lambda s: series(
            s, admin, WantedSeries("jobs", "day", (end - timedelta(days=30), end))
        ),
        "jobs an hour, two days": lambda s: series(
            s, admin, WantedSeries("jobs", "hour", (end - timedelta(days=2), end))
        ),
        "revisions a day, a month": lambda s: series(
            s, admin, WantedSeries("revisions", "day", (end - timedelta(days=30), end))
        ),
    }


def test_every_query_of_the_dashboard_is_quick_in_a_big_plant(plant: Kernel) -> None:
    slow = []
    for name, ask in queries(plant).items():
        statements: list[tuple[str, Any]] = []

        def note(_c: Any, _cursor: Any, statement: str, parameters: Any, *_: Any) -> None:
            statements.append((statement, parameters))  # noqa: B023 - removed before the next round

        with plant.db.reading() as session:
            event.listen(plant.db.engine, "before_cursor_execute", note)
            ask(session)
            event.remove(plant.db.engine, "before_cursor_execute", note)
        times = []
        for _ in range(ROUNDS):
            with plant.db.reading() as session:
                begun = time.perf_counter()
                ask(session)
                times.append((time.perf_counter() - begun) * 1000)
        p95 = statistics.quantiles(times, n=20)[-1]
        print(
            f"{name:32} p50 {statistics.median(times):7.1f} ms  p95 {p95:7.1f} ms  {len(statements)} statements"
        )
        with plant.db.engine.connect() as connection:
            for statement, parameters in statements:
                plan = connection.exec_driver_sql("EXPLAIN " + statement, parameters).scalars().all()
                print("    " + plan[0].strip() + " | " + _scan_of(plan))
        if p95 > MOST_MS or len(statements) > MOST_STATEMENTS:
            slow.append((name, p95, len(statements)))
    assert not slow, slow


def _scan_of(plan: list[str]) -> str:
    """Return the lines of a plan that tell how tables are read."""
    return "; ".join(line.strip(" ->") for line in plan if "Scan" in line)[:200]
