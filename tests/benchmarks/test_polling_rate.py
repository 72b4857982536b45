"""How many polls a second one service process answers with 304, the key checked on each."""

from __future__ import annotations

import statistics
import subprocess
import sys
from urllib.parse import urlsplit

import pytest

from tests.server import Server
from tests.service.asking import a_map, a_ready_revision, ok
from tests.service.by_hand import ByHand

pytestmark = pytest.mark.benchmark

ROBOTS = 200
SECONDS = 4.0
LEAST_A_SECOND = 1500

LOAD = """
import selectors, socket, sys, time
host, port, seconds, *requests = sys.argv[1:]
selector, sent, done, wrong = selectors.DefaultSelector(), {}, 0, 0
for text in requests[:16]:
    connection = socket.create_connection((host, int(port)))
    sent[connection] = 0
    selector.register(connection, selectors.EVENT_READ)
ask = [text.encode().decode("unicode_escape").encode() for text in requests]
turn = 0
for connection in sent:
    connection.sendall(ask[turn % len(ask)])
    turn += 1
end = time.monotonic() + float(seconds)
while time.monotonic() < end:
    for key, _ in selector.select():
        got = key.fileobj.recv(65536)
        done += got.startswith(b"HTTP/1.1 304")
        wrong += not got.startswith(b"HTTP/1.1 304")
        key.fileobj.sendall(ask[turn % len(ask)])
        turn += 1
print(done, wrong)
"""


def test_polls_answered_from_memory(server: Server) -> None:
    client, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(client)
    for _ in range(2):
        n = a_ready_revision(client, by_hand, map_id)
    ok(client.post(f"/v1/maps/{map_id}/revisions/1/publish", json={}))
    where = f"/v1/maps/{map_id}/published"
    keys = [
        ok(client.post("/v1/robots", json={"name": f"AMR {k}", "map_id": map_id}), 201)["key"]
        for k in range(ROBOTS)
    ]
    stages = {"revision": n, "stages": [{"share": 0.5}]}
    ok(client.post(f"/v1/maps/{map_id}/rollouts", json=stages), 201)
    tags = [client.get(where, headers={"Authorization": f"Bearer {key}"}).headers["etag"] for key in keys]
    assert len(set(tags)) == 2, "half of them have their revision from a roll-out"
    address = urlsplit(server.url)
    assert address.hostname is not None
    asks = [
        f"GET {where} HTTP/1.1\\r\\nHost: x\\r\\nAuthorization: Bearer {key}\\r\\n"
        f"If-None-Match: {tag}\\r\\n\\r\\n"
        for key, tag in zip(keys, tags, strict=True)
    ]
    command = [sys.executable, "-c", LOAD, address.hostname, str(address.port), str(SECONDS), *asks]
    rates = []
    for _ in range(3):
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        answered, wrong = map(int, done.stdout.split())
        assert wrong == 0
        rates.append(answered / SECONDS)
    shown = [round(rate) for rate in rates]
    print(f"\n{ROBOTS} robots' keys, half of them in a roll-out: {shown} answers of 304 a second")
    assert statistics.median(rates) >= LEAST_A_SECOND
