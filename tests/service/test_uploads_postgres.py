"""Uploads on PostgreSQL: the same answers, with the job delivered in the same transaction."""

from __future__ import annotations

import base64
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import psycopg
import pytest
from psycopg import sql
from pydantic import SecretStr
from sqlalchemy import text
from sqlalchemy.orm import Session

from service.app import open_kernel
from service.db.blobs import is_recorded, record_blob
from service.domain.errors import DatabaseBusy, StorageFull
from service.settings import Settings
from service.storage.pieces import PieceStore
from service.usecases.bytes_first import bytes_first
from service.usecases.kernel import Kernel
from service.usecases.resumable_upload import begun_whole
from tests import files
from tests.patience import soon
from tests.server import Server

pytestmark = pytest.mark.postgres

TUS = {"Tus-Resumable": "1.0.0"}


def new_map(client: httpx.Client) -> str:
    made = client.post("/v1/maps", json={"site": "plant", "name": "postgres"})
    assert made.status_code == 201, made.text
    identifier: str = made.json()["id"]
    return identifier


def delivered(server: Server) -> list[str]:
    with server.kernel.db.reading() as session:
        rows = session.execute(text("SELECT args ->> 'job_id' FROM procrastinate_jobs ORDER BY id"))
        return [row[0] for row in rows]


def test_uploads_in_one_piece_and_in_pieces(postgres_served: Server) -> None:
    client = postgres_served.client(postgres_served.admin_key)
    map_id = new_map(client)
    key = {"Idempotency-Key": "one"}
    sent = [
        client.post(f"/v1/maps/{map_id}/drawings", files={"file": ("a.png", files.png())}, headers=key)
        for _ in range(2)
    ]
    assert [answer.status_code for answer in sent] == [202, 202], sent[0].text
    assert sent[0].content == sent[1].content
    drawing = sent[0].json()["drawing"]
    changed = client.patch(f"/v1/drawings/{drawing['id']}", json={"scale": {"metres_per_unit": 0.05}})
    assert changed.status_code == 202, changed.text
    ply = files.ply(files.room())
    said = {"map_id": map_id, "kind": "scan", "filename": "room.ply"}
    told = ",".join(f"{name} {base64.b64encode(value.encode()).decode()}" for name, value in said.items())
    made = client.post("/v1/tus", headers=TUS | {"Upload-Length": str(len(ply)), "Upload-Metadata": told})
    assert made.status_code == 201, made.text
    piece = TUS | {"Content-Type": "application/offset+octet-stream", "Upload-Offset": "0"}
    done = client.patch(made.headers["location"], headers=piece, content=ply)
    assert done.status_code == 204, done.text
    scan = client.get(done.headers["groundplan-result"]).json()
    assert scan["size_bytes"] == len(ply)
    jobs = [sent[0].json()["job"]["id"], changed.json()["job"]["id"], scan["job"]["id"]]
    assert delivered(postgres_served) == jobs
    listed = client.get(f"/v1/maps/{map_id}/drawings").json()["items"]
    assert [(row["id"], row["job"]["id"]) for row in listed] == [(drawing["id"], jobs[1])]


def test_the_same_request_many_times_at_once_is_one_drawing(postgres_served: Server) -> None:
    client = postgres_served.client(postgres_served.admin_key)
    map_id, png = new_map(client), files.png()
    barrier, answers = threading.Barrier(8), []

    def send() -> None:
        one = postgres_served.client(postgres_served.admin_key)
        barrier.wait()
        answers.append(
            one.post(
                f"/v1/maps/{map_id}/drawings",
                files={"file": ("a.png", png)},
                headers={"Idempotency-Key": "the-same"},
            )
        )

    threads = [threading.Thread(target=send) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.status_code for answer in answers} == {202}, [answer.text for answer in answers]
    assert len({answer.content for answer in answers}) == 1
    assert len(client.get(f"/v1/maps/{map_id}/drawings").json()["items"]) == 1
    assert len(delivered(postgres_served)) == 1


class Halted:
    """A deferred trigger that lets each commit of a table's rows wait until it is let go."""

    def __init__(self, door: psycopg.Connection[tuple[int]], table: str) -> None:
        self._door = door
        door.execute("SELECT pg_advisory_lock(1)")
        add_trigger(door, table, "BEGIN PERFORM pg_advisory_xact_lock(1); RETURN NULL; END")

    def is_reached(self) -> bool:
        """Return whether a commit waits."""
        return self._door.execute("SELECT 1 FROM pg_stat_activity WHERE wait_event = 'advisory'").rowcount > 0

    def cut(self, session: Session) -> threading.Thread:
        """Break the session's connection as soon as it waits in its commit; the server does not see it."""
        driver: Any = session.connection().connection.dbapi_connection
        copy = os.dup(driver.fileno())

        def wait_and_cut() -> None:
            with socket.socket(fileno=copy) as broken:
                soon(self.is_reached)
                broken.shutdown(socket.SHUT_RDWR)

        cutter = threading.Thread(target=wait_and_cut)
        cutter.start()
        return cutter

    def let_go(self) -> None:
        """Let the server finish the commit."""
        self._door.execute("SELECT pg_advisory_unlock(1)")
        soon(lambda: not self.is_reached())


def add_trigger(door: psycopg.Connection[tuple[int]], table: str, body: str) -> None:
    """Let each commit of rows of the table run the body."""
    door.execute(
        sql.SQL("CREATE FUNCTION at_commit() RETURNS trigger LANGUAGE plpgsql AS {}").format(
            sql.Literal(body)
        )
    )
    door.execute(
        sql.SQL(
            "CREATE CONSTRAINT TRIGGER at_commit AFTER INSERT ON {} DEFERRABLE INITIALLY DEFERRED"
            " FOR EACH ROW EXECUTE FUNCTION at_commit()"
        ).format(sql.Identifier(table))
    )


@pytest.fixture
def door(postgres_url: str) -> Iterator[psycopg.Connection[tuple[int]]]:
    with psycopg.connect(postgres_url.replace("+psycopg", ""), autocommit=True) as connection:
        yield connection


@pytest.fixture
def kernel(postgres_url: str, tmp_path: Path) -> Iterator[Kernel]:
    found = open_kernel(Settings(data_dir=tmp_path, database_url=SecretStr(postgres_url)))
    yield found
    found.db.close()


def store(kernel: Kernel, session: Session) -> str:
    with kernel.blobs.stage(max_bytes=100) as staged:
        staged.write(b"a drawing")
        stored = staged.keep()
    record_blob(session, stored.sha256, size_bytes=9, media_type="image/png", now=kernel.now())
    return stored.sha256


def test_files_stay_where_a_commit_got_no_answer(kernel: Kernel, door: Any, tmp_path: Path) -> None:
    pieces, upload_id, halted = PieceStore(tmp_path), kernel.new_id("upl"), Halted(door, "blobs")

    def store_and_lose_the_answer() -> None:
        with bytes_first(kernel), begun_whole(kernel, pieces) as begun, kernel.db.writing("test") as session:
            pieces.create(upload_id)
            begun.append(upload_id)
            stored.append(store(kernel, session))
            cutters.append(halted.cut(session))

    stored: list[str] = []
    cutters: list[threading.Thread] = []
    with pytest.raises(DatabaseBusy):
        store_and_lose_the_answer()
    cutters[0].join()
    assert not has_row(kernel, stored[0]), "the commit is not over"
    halted.let_go()
    soon(lambda: has_row(kernel, stored[0]))
    assert kernel.blobs.exists(stored[0]), "a row without its bytes"
    assert pieces.path(upload_id).exists(), "the same for an upload in pieces"


@pytest.mark.parametrize("when", ["in the commit", "before it"])
def test_files_go_again_where_nothing_was_committed(kernel: Kernel, door: Any, when: str) -> None:
    stored = []
    if when == "in the commit":
        add_trigger(door, "blobs", "BEGIN RAISE EXCEPTION USING ERRCODE = '53100'; END")

    def store_in_vain() -> None:
        with bytes_first(kernel), kernel.db.writing("test") as session:
            stored.append(store(kernel, session))
            if when == "before it":
                session.execute(text("SET LOCAL statement_timeout = 1"))
                session.execute(text("SELECT pg_sleep(60)"))

    with pytest.raises(StorageFull if when == "in the commit" else DatabaseBusy):
        store_in_vain()
    assert not kernel.blobs.exists(stored[0])


def has_row(kernel: Kernel, sha256: str) -> bool:
    with kernel.db.reading() as session:
        return is_recorded(session, sha256)
