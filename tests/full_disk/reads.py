"""A disk that is full to the last byte: everything is read, also by a service that starts there.

Run by `test_full_disk.py` in a mount namespace of its own.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.full_disk.small_disk import RESERVE_BYTES, mounted
from tests.full_disk.upload_stages import Story
from tests.server import start
from tests.service.asking import ok, refused


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Story]:
    """Give a service whose disk has become full."""
    with mounted(tmp_path_factory.mktemp("full") / "disk") as disk:
        made = Story(disk)
        disk.fill()
        try:
            yield made
        finally:
            disk.make_room()
            made.server.close()


def test_every_list_and_thing_is_shown(full: Story) -> None:
    assert full.disk.free_bytes == 0
    full.assert_still_read()
    paths = ok(full.client.get("/openapi.json"))["paths"]
    seen = {}
    for path, operations in paths.items():
        if "get" not in operations or path in {"/v1/events", "/v1/maps/{map_id}/revisions/{n}/delta"}:
            continue
        where = path.replace("{map_id}", full.map_id).replace("{n}", str(full.n))
        seen[path] = full.client.get(where, params={"with": full.n, "q": "x"}).status_code
    assert len(seen) > 40
    asks_for_a_job = {"/v1/maps/{map_id}/revisions/{n}/compare": 507}
    assert {path: status for path, status in seen.items() if status >= 500} == asks_for_a_job
    assert seen["/v1/maps/{map_id}/revisions/{n}"] == 200


def test_what_writes_rows_alone_is_told_too(full: Story) -> None:
    for _ in range(400):  # until the room that the log of the database has is used up, too
        answer = full.client.post("/v1/keys", json={"name": "k" * 100, "role": "tablet"})
        if answer.status_code != 201:
            break
    refused(answer, 507, "storage-full")
    full.assert_still_read()


def test_a_service_that_starts_there_gives_what_is_stored(full: Story) -> None:
    key = full.server.admin_key
    full.disk.make_room()
    full.server.close()
    assert not list(full.settings.data_dir.glob("*-wal")), "it ended well, and SQLite took its files away"
    full.disk.fill()
    assert full.disk.free_bytes == 0
    told = {"GROUNDPLAN_RESERVE_BYTES": str(RESERVE_BYTES), "GROUNDPLAN_LOG_LEVEL": "error"}
    full.server = start(full.settings, admin_key=key, **told)
    full.client = full.server.client(key)
    full.assert_still_read()
