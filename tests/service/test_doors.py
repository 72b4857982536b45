"""The last admin key, foreign hosts and forwarded headers."""

from __future__ import annotations

import base64
import socket
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.db.keys import lock_admin_keys
from service.settings import Settings
from tests import web
from tests.patience import PATIENCE_S
from tests.server import Server, running, start
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

FIRST = "key_" + "0" * 26
DATABASES = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
ROUNDS = 8


@pytest.fixture(params=DATABASES)
def fresh(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """Give a service of its own on either database."""
    url = None if request.param == "sqlite" else request.getfixturevalue("postgres_url")
    with running(Settings(data_dir=tmp_path / "data", database_url=url)) as started:
        yield started


def an_admin(admin: httpx.Client, **more: Any) -> dict[str, Any]:
    """Return a new admin key."""
    return ok(admin.post("/v1/keys", json={"name": "another", "role": "admin", **more}), 201)


def in_days(days: float) -> str:
    """Return an instant so many days from now."""
    return (datetime.now(UTC) + timedelta(days=days)).isoformat()


def test_the_last_admin_key_stays(fresh: Server) -> None:
    admin = fresh.client(fresh.admin_key)
    map_id = a_map(admin)
    an_admin(admin, expires_at=in_days(1))
    an_admin(admin, map_ids=[map_id])
    ok(admin.post("/v1/keys", json={"name": "r", "role": "robot"}), 201)
    gone = an_admin(admin)
    assert admin.delete(f"/v1/keys/{gone['id']}").status_code == 204
    problem = refused(admin.delete(f"/v1/keys/{FIRST}"), 409, "last-admin-key")
    assert "make one first" in problem["detail"]
    ok(admin.get("/v1/keys"))
    other = an_admin(admin)
    assert admin.delete(f"/v1/keys/{FIRST}").status_code == 204
    left = fresh.client(other["key"])
    assert left.delete(f"/v1/keys/{FIRST}").status_code == 204  # again: nothing changes
    refused(left.delete(f"/v1/keys/{other['id']}"), 409, "last-admin-key")


def test_of_keys_that_end_the_one_that_lasts_longest_stays(fresh: Server) -> None:
    admin = fresh.client(fresh.admin_key)
    long, short = an_admin(admin, expires_at=in_days(9)), an_admin(admin, expires_at=in_days(8))
    with fresh.kernel.db.writing("revoke-key") as session:
        for key in lock_admin_keys(session, now=fresh.kernel.now()):
            if key.id == FIRST:
                key.revoked_at = fresh.kernel.now()  # as a row may stand that an older version left
    by_long = fresh.client(long["key"])
    refused(by_long.delete(f"/v1/keys/{long['id']}"), 409, "last-admin-key")
    equal = an_admin(by_long, expires_at=long["expires_at"])
    assert by_long.delete(f"/v1/keys/{short['id']}").status_code == 204
    assert by_long.delete(f"/v1/keys/{long['id']}").status_code == 204
    refused(fresh.client(equal["key"]).delete(f"/v1/keys/{equal['id']}"), 409, "last-admin-key")


def test_of_two_that_revoke_each_other_one_stays(fresh: Server) -> None:
    """Each round leaves two admin keys, which revoke each other at once."""
    keys = {FIRST: fresh.admin_key}
    for _ in range(ROUNDS):
        (one, one_secret), *_ = keys.items()
        made = an_admin(fresh.client(one_secret))
        pair = {one: one_secret, made["id"]: made["key"]}
        ready = threading.Barrier(2)
        statuses: list[int] = []

        def revoke(secret: str, other: str, ready: threading.Barrier, told: list[int]) -> None:
            with web.Client(base_url=fresh.url, headers={"Authorization": f"Bearer {secret}"}) as client:
                client.get("/healthz")
                ready.wait(timeout=PATIENCE_S)
                told.append(client.delete(f"/v1/keys/{other}", timeout=PATIENCE_S).status_code)

        others = dict(zip(pair, reversed(pair), strict=True))
        threads = [
            threading.Thread(target=revoke, args=(secret, others[key_id], ready, statuses))
            for key_id, secret in pair.items()
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(timeout=PATIENCE_S)
        assert sorted(statuses) in ([204, 401], [204, 409]), statuses
        keys = {k: s for k, s in pair.items() if fresh.client(s).get("/v1/keys").status_code == 200}
        assert len(keys) == 1
    with fresh.kernel.db.writing("revoke-key") as session:
        assert [key.id for key in lock_admin_keys(session, now=fresh.kernel.now())] == list(keys)


def _links(told: Any) -> list[str]:
    """Return every address in an answer's JSON."""
    if isinstance(told, dict):
        return [url for value in told.values() for url in _links(value)]
    if isinstance(told, list):
        return [url for value in told for url in _links(value)]
    return [told] if isinstance(told, str) and "://" in told else []


FOREIGN = [
    "evil.example",
    "evil.example:80",
    "127.0.0.1.evil.example",
    "localhost@evil.example",
    "evil.example#localhost",
    "[::1].evil.example",
    "127.0.0.1:80@evil.example",
    "10.9.8.7",
    "",
]


@pytest.mark.parametrize("host", FOREIGN)
def test_no_link_has_a_foreign_host(server: Server, admin: httpx.Client, by_hand: ByHand, host: str) -> None:
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    where = f"/v1/maps/{map_id}/revisions/1"
    forged = {"Host": host, "X-Forwarded-Host": "evil.example", "Forwarded": "host=evil.example"}
    forged |= {"X-Forwarded-Proto": "https", "X-Forwarded-For": "6.6.6.6"}
    metadata = f"kind c2Nhbg==,map_id {base64.b64encode(map_id.encode()).decode()}"
    tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "9", "Upload-Metadata": metadata}
    found = []
    for method, path in (
        ("GET", f"{where}/artifacts"),
        ("GET", f"{where}/link?path=point-cloud.pcd"),
        ("GET", "/v1/maps/none"),
        ("GET", "/v1/jobs"),
        ("POST", "/v1/tus"),
    ):
        answer = admin.request(method, path, headers={**forged, **(tus if path == "/v1/tus" else {})})
        found += _links(answer.json() if answer.content else {}) + _links(answer.headers.get("location"))
        assert path != "/v1/tus" or answer.headers["location"].startswith("/v1/tus/")
    assert len(found) > 3
    assert {url.partition("/v1/")[0].partition("/problems/")[0] for url in found} == {server.url}


@pytest.mark.parametrize("host", ["localhost:1234", "LOCALHOST", "127.0.0.1:8443", socket.gethostname()])
def test_names_of_this_machine_are_kept(admin: httpx.Client, host: str) -> None:
    problem = admin.get("/v1/maps/none", headers={"Host": host}).json()
    assert problem["type"] == f"http://{host.lower()}/problems/map-not-found"


def _type_told(server: Server, **headers: str) -> str:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    told: str = web.get(f"{server.url}/v1/maps", headers=named).json()["type"]
    return told.removesuffix("/problems/unauthenticated")


def test_hosts_and_fronts_that_were_set_are_believed(tmp_path: Path) -> None:
    told = {"Host": "maps.plant.example", "X_Forwarded_Proto": "https"}
    hosts = {"GROUNDPLAN_TRUSTED_HOSTS": "other.example, Maps.Plant.Example"}
    with running(Settings(data_dir=tmp_path), **hosts) as server:
        assert _type_told(server, **told) == "http://maps.plant.example"
        assert _type_told(server, Host="evil.example") == server.url
        key = server.admin_key
    for networks, scheme in (("127.0.0.0/8", "https"), ("10.0.0.0/8", "http")):
        again = start(Settings(data_dir=tmp_path), admin_key=key, GROUNDPLAN_FRONT_NETWORKS=networks, **hosts)
        try:
            assert _type_told(again, **told) == f"{scheme}://maps.plant.example"
        finally:
            again.close()
    public = start(Settings(data_dir=tmp_path), admin_key=key, GROUNDPLAN_PUBLIC_URL="https://p.example/")
    try:
        assert _type_told(public, Host="evil.example") == "https://p.example"
    finally:
        public.close()
