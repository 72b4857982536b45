"""A client of uploads in pieces that does one request at a time, so that tests come in between."""

from __future__ import annotations

import base64
import hashlib
import socket
from pathlib import Path
from typing import Any

import httpx

from tests import files
from tests.patience import soon
from tests.server import Server

PLY = files.ply(files.room(200_000))
SHA256 = hashlib.sha256(PLY).hexdigest()
TUS = {"Tus-Resumable": "1.0.0"}
PIECE = TUS | {"Content-Type": "application/offset+octet-stream"}


def new_map(admin: httpx.Client, name: str) -> str:
    made = admin.post("/v1/maps", json={"site": "tus", "name": name})
    assert made.status_code == 201, made.text
    identifier: str = made.json()["id"]
    return identifier


def metadata(**values: str) -> str:
    return ",".join(f"{key} {base64.b64encode(value.encode()).decode()}" for key, value in values.items())


def create(client: httpx.Client, map_id: str, *, size: int = len(PLY), **more: Any) -> httpx.Response:
    headers = more.pop("headers", {})
    said = {"map_id": map_id, "kind": "scan", "filename": "room.ply"} | more
    told = TUS | {"Upload-Length": str(size), "Upload-Metadata": metadata(**said)}
    return client.post("/v1/tus", headers=told | headers)


def begin(client: httpx.Client, map_id: str, **more: Any) -> str:
    answer = create(client, map_id, **more)
    assert answer.status_code == 201, answer.text
    location: str = answer.headers["location"]
    return location


def offset(client: httpx.Client, location: str) -> int:
    answer = client.head(location, headers=TUS)
    assert answer.status_code == 200, answer.status_code
    return int(answer.headers["upload-offset"])


def offset_when_free(client: httpx.Client, location: str) -> int:
    """Return the offset after whoever writes has ended."""
    soon(lambda: client.head(location, headers=TUS).status_code != 423, "somebody writes for ever")
    return offset(client, location)


def piece(client: httpx.Client, location: str, at: int, content: bytes, **headers: str) -> httpx.Response:
    told = PIECE | {"Upload-Offset": str(at)} | headers
    return client.patch(location, headers=told, content=content)


def checksum(content: bytes, algorithm: str = "sha1") -> str:
    return f"{algorithm} {base64.b64encode(hashlib.new(algorithm, content).digest()).decode()}"


def problem(answer: httpx.Response, status: int, slug: str) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["tus-resumable"] == "1.0.0"
    body: dict[str, Any] = answer.json()
    assert body["type"].endswith(f"/problems/{slug}"), body
    return body


def stored(server: Server, location: str) -> Path:
    return server.settings.data_dir / "uploads" / location.rpartition("/")[2]


def slow_piece(server: Server, key: str, location: str, at: int, content: bytes) -> socket.socket:
    """Return a connection that has sent the head of a PATCH for the rest of the file, and `content` of it."""
    address = httpx.URL(server.url)
    connection = socket.create_connection((address.host, address.port or 80))
    connection.sendall(
        (
            f"PATCH {httpx.URL(location).path} HTTP/1.1\r\nHost: x\r\nAuthorization: {key}\r\n"
            f"Tus-Resumable: 1.0.0\r\nContent-Type: {PIECE['Content-Type']}\r\nUpload-Offset: {at}\r\n"
            f"Content-Length: {len(PLY) - at}\r\n\r\n"
        ).encode()
        + content
    )
    return connection


def wait_until_stored(path: Path, least: int) -> None:
    soon(lambda: path.exists() and path.stat().st_size >= least, f"{path} has fewer than {least} bytes")


def scans(client: httpx.Client, map_id: str) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = client.get(f"/v1/maps/{map_id}/scans", params={"limit": 200}).json()["items"]
    return rows
