"""The same POST sent twice, at once, or after a crash has one effect and one answer."""

from __future__ import annotations

import signal
import threading
from pathlib import Path

import httpx
import pytest

from service.settings import Settings
from tests.server import ClientFor, Server, start
from tests.service.asking import a_map, ok, refused


def _key(value: str) -> dict[str, str]:
    return {"Idempotency-Key": value}


def test_a_repeated_post_gets_the_first_answer(admin: httpx.Client) -> None:
    body = {"site": "Idem", "name": "a"}
    first = admin.post("/v1/maps", json=body, headers=_key("a"))
    again = admin.post("/v1/maps", json=body, headers=_key("a"))
    assert (first.status_code, first.content, first.headers["location"]) == (
        again.status_code,
        again.content,
        again.headers["location"],
    )
    assert "idempotent-replayed" not in first.headers
    assert again.headers["idempotent-replayed"] == "true"
    assert len(ok(admin.get("/v1/maps?site=Idem"))["items"]) == 1


def test_another_request_under_the_key_is_refused(admin: httpx.Client) -> None:
    ok(admin.post("/v1/maps", json={"site": "Idem", "name": "b"}, headers=_key("b")), 201)
    other_body = admin.post("/v1/maps", json={"site": "Idem", "name": "c"}, headers=_key("b"))
    refused(other_body, 422, "idempotency-key-reused")
    other_path = admin.post("/v1/keys", json={"site": "Idem", "name": "b"}, headers=_key("b"))
    assert other_path.status_code == 422
    assert [m["name"] for m in ok(admin.get("/v1/maps?site=Idem&q=c"))["items"]] == []


def test_a_refusal_is_not_remembered(admin: httpx.Client) -> None:
    taken = ok(admin.post("/v1/maps", json={"site": "Idem", "name": "d"}), 201)
    body = {"site": "Idem", "name": "d"}
    refused(admin.post("/v1/maps", json=body, headers=_key("d")), 409, "map-name-taken")
    ok(admin.patch(f"/v1/maps/{taken['id']}", json={"name": "d, moved away"}))
    ok(admin.post("/v1/maps", json=body, headers=_key("d")), 201)


def test_keys_of_two_callers_do_not_meet(admin: httpx.Client, client_for: ClientFor) -> None:
    other = client_for("admin")
    first = ok(admin.post("/v1/maps", json={"site": "Idem", "name": "e"}, headers=_key("e")), 201)
    second = ok(other.post("/v1/maps", json={"site": "Idem", "name": "f"}, headers=_key("e")), 201)
    assert first["id"] != second["id"]


@pytest.mark.parametrize("key", ["", "a b", "x" * 256, "ü".encode().decode("latin-1")])
def test_a_bad_key_is_refused(admin: httpx.Client, key: str) -> None:
    headers = {"Idempotency-Key": key.encode("latin-1")}
    answer = admin.post("/v1/maps", json={"site": "Idem", "name": "g"}, headers=headers)
    refused(answer, 422, "invalid-request")


def test_a_secret_is_given_again_but_kept_nowhere(server: Server, admin: httpx.Client) -> None:
    body = {"name": "tablet", "role": "tablet"}
    first = ok(admin.post("/v1/keys", json=body, headers=_key("k")), 201)
    again = ok(admin.post("/v1/keys", json=body, headers=_key("k")), 201)
    assert first == again
    assert ok(server.client(first["key"]).get("/v1/maps"))
    secret = first["key"].encode()
    kept = [path for path in server.settings.data_dir.rglob("*") if path.is_file()]
    assert not [path for path in kept if secret in path.read_bytes()]


def _race(server: Server, *, senders: int) -> list[httpx.Response]:
    barrier = threading.Barrier(senders)
    answers: list[httpx.Response] = []

    def send(client: httpx.Client) -> None:
        barrier.wait()
        answers.append(client.post("/v1/maps", json={"site": "Race", "name": "r"}, headers=_key("race")))

    clients = [server.client(server.admin_key) for _ in range(senders)]
    threads = [threading.Thread(target=send, args=(client,)) for client in clients]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return answers


def _assert_one_effect(server: Server) -> None:
    answers = _race(server, senders=8)
    assert {answer.status_code for answer in answers} == {201}, [answer.text for answer in answers]
    assert len({answer.content for answer in answers}) == 1
    assert sum("idempotent-replayed" not in answer.headers for answer in answers) == 1
    assert len(ok(server.client(server.admin_key).get("/v1/maps?site=Race"))["items"]) == 1


def test_eight_at_once_have_one_effect_on_sqlite(server: Server) -> None:
    _assert_one_effect(server)


@pytest.mark.postgres
def test_eight_at_once_have_one_effect_on_postgres(postgres_served: Server) -> None:
    _assert_one_effect(postgres_served)


@pytest.mark.parametrize(("when", "made"), [("before-commit", 0), ("after-commit", 1)])
def test_after_a_crash_there_is_the_effect_with_its_answer_or_neither(
    tmp_path: Path, when: str, made: int
) -> None:
    settings = Settings(data_dir=tmp_path)
    first = start(settings, GROUNDPLAN_CRASH_AT=f"create-map.{when}")
    body = {"site": "Crash", "name": "c"}
    with pytest.raises(httpx.TransportError):
        first.client(first.admin_key).post("/v1/maps", json=body, headers=_key("c"))
    assert first.process.wait(timeout=10) == -signal.SIGKILL
    first.close()
    second = start(settings, admin_key=first.admin_key)
    try:
        client = second.client(second.admin_key)
        before = ok(client.get("/v1/maps"))["items"]
        assert len(before) == made
        answer = client.post("/v1/maps", json=body, headers=_key("c"))
        ok(answer, 201)
        assert ("idempotent-replayed" in answer.headers) == bool(made)
        after = ok(client.get("/v1/maps"))["items"]
        assert [m["id"] for m in after] == [answer.json()["id"]]
        assert not made or after == before
    finally:
        second.close()


def test_posts_without_a_body_are_remembered_too(admin: httpx.Client) -> None:
    map_id = a_map(admin)
    answer = admin.post(f"/v1/maps/{map_id}/revisions/1/publish", headers=_key("nothing"))
    assert answer.status_code == 422
