"""Webhooks over HTTP: who may have them, what is refused, and what a real worker delivers, signed."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import SecretStr
from standardwebhooks.webhooks import Webhook, WebhookVerificationError

from service.settings import Settings
from tests.patience import soon
from tests.receiver import Letter, Receiver, receiving
from tests.server import ROOT, Server, environment, new_client, running
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand
from tests.service.fleets import Fleet

EVERYTHING = [
    "revision.ready",
    "revision.published",
    "placement.judged",
    "job.failed",
    "robot.failed",
    "rollout.stopped",
    "rollout.finished",
]
LOOPBACK = {"GROUNDPLAN_WEBHOOK_NETWORKS": "127.0.0.0/8"}


@contextmanager
def working(server: Server) -> Iterator[None]:
    """Run a worker on a service's data."""
    with (server.settings.data_dir / "worker.log").open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "worker"],
            cwd=ROOT,
            env=environment(server.settings, **LOOPBACK),
            stdout=log,
            stderr=log,
        )
    try:
        yield
    finally:
        process.kill()
        process.wait()


@pytest.fixture(params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def allowing(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Server]:
    """Give a service whose webhooks may lie on loopback."""
    url = SecretStr(request.getfixturevalue("postgres_url")) if request.param == "postgres" else None
    with running(Settings(data_dir=tmp_path / "data", database_url=url), **LOOPBACK) as server:
        yield server


def hook(admin: httpx.Client, url: str, **more: Any) -> dict[str, Any]:
    return ok(admin.post("/v1/webhooks", json={"url": url, "events": EVERYTHING, **more}), 201)


def verified(letter: Letter, secret: str) -> dict[str, Any]:
    """Return what a letter says, once an independent package has found its signature right."""
    told: dict[str, Any] = Webhook(secret).verify(letter.body, letter.headers)
    assert told == json.loads(letter.body)
    return told


def _happen(fleet: Fleet, by_hand: ByHand) -> list[dict[str, Any]]:
    """Let one of each event happen, and return what has to be told of them, in their order."""
    admin, map_id, told = fleet.admin, fleet.map_id, []

    def tell(event: str, /, **data: Any) -> None:
        told.append({"type": event, "data": {"map_id": map_id, **data}})

    n = a_ready_revision(admin, by_hand, map_id)
    job = ok(admin.get(f"/v1/maps/{map_id}/revisions/{n}"))["job_id"]
    tell("revision.ready", revision=n, job_id=job)
    placement = ok(admin.get(f"/v1/placements/{a_placement(admin, by_hand, map_id)}"))
    tell("placement.judged", placement_id=placement["id"], scan_id=placement["scan_id"], verdict="accepted")
    again = ok(admin.post(f"/v1/scans/{placement['scan_id']}/placements", json={}), 202)
    problem = {"slug": "placement-not-computed", "title": "No placement could be computed", "detail": "."}
    by_hand.fail(again["job"]["id"], problem=problem)
    subject = again["placement"]["id"]
    tell("job.failed", job_id=again["job"]["id"], kind="place-scan", subject_id=subject, problem=problem)
    robot = fleet.robots[0]
    rollout = fleet.begin({"share": 1.0})
    robot.say("failed", 2, "disk full")
    name = ok(robot.client.get(f"/v1/robots/{robot.id}"))["name"]
    tell("robot.failed", robot_id=robot.id, name=name, revision=2, detail="disk full")
    reason = fleet.until(rollout, state="stopped")["reason"]
    tell("rollout.stopped", rollout_id=rollout, channel="stable", revision=2, reason=reason)
    fleet.change(rollout, "resume")
    robot.say("enabled", 2)
    fleet.until(rollout, state="finished")
    tell("revision.published", channel="stable", from_revision=1, to_revision=2)
    tell("rollout.finished", rollout_id=rollout, channel="stable", revision=2, reason=None)
    return told


def test_every_event_is_delivered_once_and_signed(allowing: Server) -> None:
    fleet = Fleet(allowing, robots=1)
    by_hand = ByHand(allowing.kernel)
    with receiving() as everything, receiving() as elsewhere, receiving() as some:
        made = hook(fleet.admin, everything.url)
        hook(fleet.admin, elsewhere.url, map_ids=[a_map(fleet.admin)])
        few = hook(fleet.admin, some.url, events=["robot.failed"], map_ids=[fleet.map_id])
        told = _happen(fleet, by_hand)
        with working(allowing):
            soon(lambda: len(everything.letters) >= len(told) and some.letters, patience_s=60.0)
            renewed = ok(fleet.admin.post(f"/v1/webhooks/{made['id']}/secret"))
            fleet.robots[0].say("failed", 2, "again")
            soon(lambda: len(everything.letters) > len(told) and len(some.letters) == 2, patience_s=30.0)
        log = soon(lambda: _all_delivered(fleet.admin, made["id"]))
        assert elsewhere.letters == []
    heard = [verified(letter, made["secret"]) for letter in everything.letters]
    key = str
    assert sorted(({k: e[k] for k in ("type", "data")} for e in heard[:-1]), key=key) == sorted(told, key=key)
    assert len({letter.headers["webhook-id"] for letter in everything.letters}) == len(heard)
    assert {letter.path for letter in everything.letters} == {"/hook"}
    verified(everything.letters[-1], renewed["secret"])
    with pytest.raises(WebhookVerificationError):
        verified(everything.letters[0], renewed["secret"])
    assert [verified(letter, few["secret"])["data"]["detail"] for letter in some.letters] == [
        "disk full",
        "again",
    ]
    assert {d["id"] for d in log} == {letter.headers["webhook-id"] for letter in everything.letters}
    assert all([t["status"] for t in d["tries"]] == [204] for d in log)


def _all_delivered(admin: httpx.Client, webhook_id: str) -> list[dict[str, Any]] | None:
    found: list[dict[str, Any]] = ok(admin.get(f"/v1/webhooks/{webhook_id}/deliveries"))["items"]
    return found if {d["state"] for d in found} == {"delivered"} else None


def test_what_fails_is_tried_again_and_a_receiver_that_is_gone_is_left_alone(allowing: Server) -> None:
    fleet = Fleet(allowing, robots=1)
    with receiving() as moody, receiving() as gone:
        moody.statuses = [500, 302]
        moody.location = gone.url
        gone.statuses = [410]
        first, second = hook(fleet.admin, moody.url), hook(fleet.admin, gone.url)
        fleet.robots[0].say("failed", 1, "one")
        with working(allowing):
            fleet.robots[0].say("failed", 1, "two")
            soon(lambda: len(moody.letters) == 4, patience_s=60.0)
            soon(lambda: _all_delivered(fleet.admin, first["id"]))
            assert ok(fleet.admin.get(f"/v1/webhooks/{second['id']}"))["disabled_at"] is not None
        log = ok(fleet.admin.get(f"/v1/webhooks/{first['id']}/deliveries"))["items"]
        assert sorted([t["status"] for t in d["tries"]] for d in log) == [[302, 204], [500, 204]]
        assert all(t["error"] == f"answered {t['status']}" for d in log for t in d["tries"][:1])
        by_id: dict[str, list[bytes]] = {}
        for letter in moody.letters:
            by_id.setdefault(letter.headers["webhook-id"], []).append(letter.body)
        assert [len(set(bodies)) for bodies in by_id.values()] == [1, 1]
        assert [len(bodies) for bodies in by_id.values()] == [2, 2]
        assert len(gone.letters) == 1, "no redirect was followed, and 410 is final"
    assert fleet.admin.delete(f"/v1/webhooks/{first['id']}").status_code == 204
    refused(fleet.admin.get(f"/v1/webhooks/{first['id']}"), 404, "webhook-not-found")


def test_who_may_have_webhooks_and_where_they_may_be(server: Server, admin: httpx.Client) -> None:
    def body(url: str = "https://plant.example/hook", **more: Any) -> dict[str, Any]:
        return {"url": url, "events": ["robot.failed"], **more}

    mine, other = a_map(admin), a_map(admin)
    limited, tablet = new_client(server, "admin", maps=[mine]), new_client(server, "tablet")
    refused(tablet.post("/v1/webhooks", json=body()), 403, "forbidden")
    refused(new_client(server, "robot").get("/v1/webhooks"), 403, "forbidden")
    refused(limited.post("/v1/webhooks", json=body()), 403, "forbidden")
    refused(limited.post("/v1/webhooks", json=body(map_ids=[mine, other])), 404, "map-not-found")
    for url in (
        "http://127.0.0.1/x",
        "http://[::1]:8080/",
        "http://10.0.0.7/",
        "http://169.254.169.254/latest/meta-data",
        "http://[::ffff:192.168.1.1]/",
        "http://[64:ff9b::a00:1]/",
        "http://224.0.0.1/",
        "http://0.0.0.0/",
        "ftp://plant.example/",
        "https://user:secret@plant.example/",
        "https://plant.example/#x",
        "https://",
    ):
        refused(admin.post("/v1/webhooks", json=body(url)), 422, "invalid-request")
    refused(admin.post("/v1/webhooks", json=body(events=["robot.happy"])), 422, "invalid-request")
    made = ok(limited.post("/v1/webhooks", json=body(map_ids=[mine])), 201)
    everywhere = ok(admin.post("/v1/webhooks", json=body()), 201)
    assert made["secret"].startswith("whsec_")
    assert made["secret"] != everywhere["secret"]
    listed = ok(limited.get("/v1/webhooks"))["items"]
    assert [found["id"] for found in listed] == [made["id"]]
    assert "secret" not in listed[0]
    assert len(ok(admin.get("/v1/webhooks"))["items"]) == 2
    for path in ("", "/deliveries"):
        refused(limited.get(f"/v1/webhooks/{everywhere['id']}{path}"), 404, "webhook-not-found")
        refused(tablet.get(f"/v1/webhooks/{made['id']}{path}"), 403, "forbidden")
    refused(limited.post(f"/v1/webhooks/{everywhere['id']}/secret"), 404, "webhook-not-found")
    refused(limited.delete(f"/v1/webhooks/{everywhere['id']}"), 404, "webhook-not-found")
    refused(tablet.delete(f"/v1/webhooks/{made['id']}"), 403, "forbidden")
    renewed = ok(limited.post(f"/v1/webhooks/{made['id']}/secret"))
    assert renewed["secret"] != made["secret"]
    assert renewed["old_secret_until"] is not None


def test_a_receiver_is_reached_at_a_checked_address_or_not_at_all(receiver: Receiver) -> None:
    from service.domain.outbound import parse_networks  # noqa: PLC0415
    from worker.outbound import NotSent, post  # noqa: PLC0415

    by_name = receiver.url.replace("127.0.0.1", "localhost")
    for url in (receiver.url, by_name):
        with pytest.raises(NotSent, match="not allowed"):
            post(url, body=b"{}", headers={}, allowed=())
    assert receiver.letters == []
    assert post(by_name, body=b"{}", headers={}, allowed=parse_networks("127.0.0.1/32")) == 204
    assert receiver.letters[0].headers["host"].startswith("localhost:")
    with pytest.raises(NotSent, match="leads to no address"):
        post(f"http://{'a' * 64}.example/", body=b"{}", headers={}, allowed=())
    with pytest.raises(NotSent):
        post("http://127.0.0.1:9/", body=b"{}", headers={}, allowed=parse_networks("127.0.0.0/8"))
    with pytest.raises(NotSent, match=r"SSL|TLS|wrong version"):
        post(
            receiver.url.replace("http:", "https:"),
            body=b"",
            headers={},
            allowed=parse_networks("127.0.0.0/8"),
        )


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with receiving() as found:
        yield found
