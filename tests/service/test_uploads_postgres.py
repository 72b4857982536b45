"""Uploads on PostgreSQL: the same answers, with the job delivered in the same transaction."""

from __future__ import annotations

import base64
import threading

import httpx
import pytest
from sqlalchemy import text

from tests import files
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
