"""Files that lie, break off or explode: each has its own problem, and the service stays up and small."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import numpy as np
import psutil
import pytest

from service.settings import Settings
from tests import files
from tests.forked import forked
from tests.patience import PATIENCE_S
from tests.server import Server, environment, running
from tests.service.asking import ended

MIB = 1 << 20
LIMIT_BYTES = 1024 * MIB
MOST_RSS_BYTES = 200 * MIB
FORM = {"content-type": "multipart/form-data; boundary=b0undary"}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    settings = Settings(data_dir=tmp_path_factory.mktemp("hostile"), max_upload_bytes=LIMIT_BYTES)
    with running(settings) as server:
        worker = forked("worker", env=environment(settings), start_new_session=True)
        try:
            yield server
        finally:
            worker.send_signal(signal.SIGTERM)
            worker.wait(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def client(served: Server) -> httpx.Client:
    return served.client(served.admin_key)


@pytest.fixture(scope="module")
def map_id(client: httpx.Client) -> str:
    made = client.post("/v1/maps", json={"site": "plant", "name": "hostile"})
    identifier: str = made.json()["id"]
    return identifier


@contextmanager
def watched(server: Server) -> Iterator[list[int]]:
    """Give the list of the service's memory, sampled every 20 ms; its last item is the peak."""
    process, stop = psutil.Process(server.process.pid), threading.Event()
    seen = [process.memory_info().rss]

    def look() -> None:
        while not stop.wait(0.02):
            seen.append(process.memory_info().rss)

    watcher = threading.Thread(target=look)
    watcher.start()
    try:
        yield seen
    finally:
        stop.set()
        watcher.join()
        seen.append(max(seen))


def send(client: httpx.Client, map_id: str, kind: str, content: bytes) -> httpx.Response:
    return client.post(f"/v1/maps/{map_id}/{kind}", files={"file": ("office.png", content)})


def outcome(client: httpx.Client, answer: httpx.Response) -> dict[str, Any]:
    """Return the problem document of an upload: that of its answer, or that of its job."""
    if answer.status_code != 202:
        assert answer.headers["content-type"] == "application/problem+json"
        refused: dict[str, Any] = answer.json()
        return refused
    job = ended(client, answer.json()["job"]["id"])
    assert job["state"] == "failed", job
    problem: dict[str, Any] = job["problem"]
    return problem


def _nan_cloud(write: Any) -> bytes:
    points = files.room()
    points[17, 1] = np.nan
    content: bytes = write(points)
    return content


ROOM = files.room()
ENTITIES = b'<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><svg>&b;</svg>'
HOSTILE = {
    "truncated PLY": ("scans", lambda: files.ply(ROOM)[:-1000], "file-truncated"),
    "truncated PCD": ("scans", lambda: files.pcd(ROOM)[:-1000], "file-truncated"),
    "PLY header cut": ("scans", lambda: files.ply(ROOM)[:60], "file-truncated"),
    "PLY of 3e9 points": ("scans", lambda: files.ply_header(3_000_000_000) + bytes(1200), "too-many-points"),
    "PCD of 3e9 points": (
        "scans",
        lambda: files.pcd(ROOM).replace(b"5000", b"3000000000"),
        "too-many-points",
    ),
    "PLY promising more than it holds": (
        "scans",
        lambda: files.ply_header(40_000_000) + bytes(1200),
        "file-truncated",
    ),
    "PLY with NaN": ("scans", lambda: _nan_cloud(files.ply), "not-finite"),
    "PCD with NaN": ("scans", lambda: _nan_cloud(files.pcd), "not-finite"),
    "PLY of no point": ("scans", lambda: files.ply(ROOM[:0]), "file-empty"),
    "ASCII PLY of words": (
        "scans",
        lambda: files.ply_header(2).replace(b"binary_little_endian", b"ascii") + b"one two three\n" * 2,
        "header-mismatch",
    ),
    "empty scan": ("scans", lambda: b"", "file-empty"),
    "empty drawing": ("drawings", lambda: b"", "file-empty"),
    "text named .png": ("drawings", lambda: b"this is no picture\n" * 10, "unsupported-media"),
    "noise named .png": ("drawings", lambda: np.random.default_rng(1).bytes(5000), "unsupported-media"),
    "PNG of 60000 x 60000": ("drawings", lambda: files.white_png(60_000, 60_000), "image-too-large"),
    "truncated PNG": ("drawings", lambda: files.png(400, 300)[:-5000], "file-truncated"),
    "cut PDF": ("drawings", lambda: b"%PDF-1.7\n1 0 obj", "file-truncated"),
    "SVG with entities": ("drawings", lambda: ENTITIES, "file-malformed"),
    "cut IFC": ("drawings", lambda: b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=IFCWALL(", "file-truncated"),
    "cut DXF": ("drawings", lambda: b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n", "file-truncated"),
    "cut DWG": ("drawings", lambda: b"AC1032" + bytes(20), "file-truncated"),
    "map.yaml alone": ("drawings", lambda: b"image: a.pgm\nresolution: 0.05\n", "header-mismatch"),
    "levels that are none": ("drawings", lambda: b"levels:\n  L1: [1]\n", "file-malformed"),
    "PGM of 60000 x 60000": ("drawings", lambda: b"P5\n60000 60000\n255\n", "image-too-large"),
    "blank PNG": ("drawings", lambda: files.white_png(300, 200), "no-walls-found"),
    "PNG magic alone": ("drawings", lambda: files.PNG_MAGIC, "file-truncated"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_gets_its_own_problem(
    served: Server, client: httpx.Client, map_id: str, name: str
) -> None:
    kind, make, slug = HOSTILE[name]
    with watched(served) as rss:
        problem = outcome(client, send(client, map_id, kind, make()))
    assert problem["type"].rpartition("/")[2] == slug, problem
    assert problem["title"]
    assert len(problem["detail"]) > 20
    assert client.get("/healthz").status_code == 200
    assert rss[-1] < MOST_RSS_BYTES


def test_too_large_by_its_length_is_refused_before_it_is_sent(
    served: Server, client: httpx.Client, map_id: str
) -> None:
    sent = 0

    def body() -> Iterator[bytes]:
        nonlocal sent
        for chunk in files.form(files.zeros(2 * LIMIT_BYTES, first=files.ply_header(40_000_000))):
            sent += len(chunk)
            yield chunk

    length = sum(len(part) for part in files.form(iter([]))) + 2 * LIMIT_BYTES
    with watched(served) as rss:
        answer = client.post(
            f"/v1/maps/{map_id}/scans", content=body(), headers=FORM | {"content-length": str(length)}
        )
    assert answer.status_code == 413, answer.text
    problem = answer.json()
    assert problem["type"].endswith("/problems/upload-too-large")
    assert problem["max_upload_bytes"] == LIMIT_BYTES
    assert sent < LIMIT_BYTES
    assert rss[-1] < MOST_RSS_BYTES
    assert client.get("/healthz").status_code == 200
    _report("2 GiB, by its Content-Length", rss, sent)


@pytest.mark.slow
def test_too_large_by_its_bytes_is_cut_off_at_the_limit(
    served: Server, client: httpx.Client, map_id: str
) -> None:
    sent = 0

    def body() -> Iterator[bytes]:
        nonlocal sent
        for chunk in files.form(files.zeros(2 * LIMIT_BYTES, first=files.ply_header(40_000_000))):
            sent += len(chunk)
            yield chunk

    with watched(served) as rss:
        answer = client.post(f"/v1/maps/{map_id}/scans", content=body(), headers=FORM)
    assert answer.status_code == 413, answer.text
    assert answer.json()["type"].endswith("/problems/upload-too-large")
    assert LIMIT_BYTES <= sent < LIMIT_BYTES * 1.2
    assert rss[-1] < MOST_RSS_BYTES
    assert list((served.settings.data_dir / "blobs" / ".tmp").iterdir()) == []
    assert client.get("/healthz").status_code == 200
    _report("2 GiB, chunked", rss, sent)


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/usr/bin/curl"), reason="curl is not installed")  # noqa: PTH110 - a path
@pytest.mark.parametrize("chunked", [False, True], ids=["by length", "chunked"])
def test_curl_sees_the_refusal_too(served: Server, map_id: str, *, chunked: bool) -> None:
    transfer = ["-H", "Transfer-Encoding: chunked"] if chunked else []
    zeros = subprocess.Popen(["head", "-c", str(2 * LIMIT_BYTES), "/dev/zero"], stdout=subprocess.PIPE)
    length = [] if chunked else ["-H", f"Content-Length: {2 * LIMIT_BYTES}"]
    told = ["-H", f"Authorization: Bearer {served.admin_key}", "-H", f"Content-Type: {FORM['content-type']}"]
    ended = subprocess.run(
        [
            "curl",
            "-sS",
            "-X",
            "POST",
            *told,
            *transfer,
            *length,
            "-T",
            "-",
            f"{served.url}/v1/maps/{map_id}/scans",
        ],
        stdin=zeros.stdout,
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert zeros.stdout is not None
    zeros.stdout.close()
    zeros.wait()
    slug = "invalid-request" if chunked else "upload-too-large"
    assert f"/problems/{slug}" in ended.stdout, ended


@pytest.mark.slow
def test_memory_does_not_grow_with_the_file(served: Server, client: httpx.Client, map_id: str) -> None:
    points = 40_000_000
    header = files.ply_header(points)
    size = len(header) + 12 * points
    with watched(served) as rss:
        answer = client.post(
            f"/v1/maps/{map_id}/scans", content=files.form(files.zeros(size, first=header)), headers=FORM
        )
        assert answer.status_code == 202, answer.text
    client.post(f"/v1/jobs/{answer.json()['job']['id']}/cancel")
    assert rss[-1] < MOST_RSS_BYTES
    assert rss[-1] - rss[0] < 40 * MIB
    _report(f"{size / 1e6:.0f} MB, taken", rss, size)


def _report(what: str, rss: list[int], sent: int) -> None:
    sys.stdout.write(
        f"\n{what}: sent {sent / MIB:.0f} MiB, service RSS {rss[0] / MIB:.0f} MiB before,"
        f" {rss[-1] / MIB:.0f} MiB at most\n"
    )
