"""Jobs over HTTP: lists, cancel, retry, and events while they run."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests import web
from tests.server import ClientFor
from tests.service.asking import a_map, a_ready_revision, ok, refused
from tests.service.by_hand import ByHand

PROBLEM = {"slug": "file-truncated", "title": "The file is cut short", "detail": "It ends early.", "at": 7}


def _a_job(admin: httpx.Client, by_hand: ByHand, map_id: str) -> str:
    by_hand.drawing(map_id, read=False)
    newest = ok(admin.get("/v1/jobs", params={"map": map_id, "limit": 1}))["items"][0]
    job_id: str = newest["id"]
    return job_id


def test_jobs_are_listed_newest_first_and_filtered(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id, other = a_map(admin), a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    waiting = _a_job(admin, by_hand, map_id)
    elsewhere = _a_job(admin, by_hand, other)

    def ids(**params: Any) -> list[str]:
        return [job["id"] for job in ok(admin.get("/v1/jobs", params=params))["items"]]

    mine = ids(map=map_id)
    assert mine == sorted(mine, reverse=True)
    assert len(mine) == 3
    assert ids(map=map_id, state="queued") == [waiting]
    assert len(ids(map=map_id, kind="build-revision")) == 1
    assert ids(map=other) == [elsewhere]
    assert elsewhere in ids()
    refused(admin.get("/v1/jobs?state=lost"), 422, "invalid-request")
    page = ok(admin.get("/v1/jobs", params={"map": map_id, "limit": 2}))
    rest = ok(admin.get("/v1/jobs", params={"map": map_id, "limit": 2, "cursor": page["next_cursor"]}))
    assert [job["id"] for job in page["items"] + rest["items"]] == mine


def test_a_failed_job_carries_its_problem(admin: httpx.Client, by_hand: ByHand) -> None:
    job_id = _a_job(admin, by_hand, a_map(admin))
    by_hand.fail(job_id, problem=PROBLEM)
    shown = ok(admin.get(f"/v1/jobs/{job_id}"))
    assert shown["state"] == "failed"
    problem = shown["problem"]
    assert "status" not in problem
    assert problem["type"] == str(admin.base_url).rstrip("/") + "/problems/file-truncated"
    assert (problem["title"], problem["detail"], problem["at"]) == (
        "The file is cut short",
        "It ends early.",
        7,
    )
    assert web.get(problem["type"]).status_code == 200


def test_cancel_and_retry(admin: httpx.Client, by_hand: ByHand) -> None:
    job_id = _a_job(admin, by_hand, a_map(admin))
    refused(admin.post(f"/v1/jobs/{job_id}/retry"), 409, "job-not-retryable")
    assert ok(admin.post(f"/v1/jobs/{job_id}/cancel"), 202)["state"] == "cancelled"
    refused(admin.post(f"/v1/jobs/{job_id}/cancel"), 409, "job-not-cancellable")
    assert ok(admin.post(f"/v1/jobs/{job_id}/retry"), 202)["state"] == "queued"
    by_hand.claim(job_id)
    running = ok(admin.post(f"/v1/jobs/{job_id}/cancel"), 202)
    assert (running["state"], running["cancel_requested"]) == ("running", True)


def test_jobs_of_other_maps_do_not_exist(admin: httpx.Client, by_hand: ByHand, client_for: ClientFor) -> None:
    map_id = a_map(admin)
    job_id = _a_job(admin, by_hand, map_id)
    tablet = client_for("tablet", [a_map(admin)])
    assert ok(tablet.get("/v1/jobs"))["items"] == []
    assert ok(tablet.get("/v1/jobs", params={"map": map_id}))["items"] == []
    for answer in (
        tablet.get(f"/v1/jobs/{job_id}"),
        tablet.get(f"/v1/jobs/{job_id}/events"),
        tablet.post(f"/v1/jobs/{job_id}/cancel"),
        tablet.post(f"/v1/jobs/{job_id}/retry"),
    ):
        refused(answer, 404, "job-not-found")


def _events(answer: httpx.Response) -> Iterator[tuple[str, dict[str, Any]]]:
    """Give the id and the job of each event of a stream."""
    event_id = ""
    for line in answer.iter_lines():
        if line.startswith("id: "):
            event_id = line.removeprefix("id: ")
        elif line.startswith("data: "):
            yield event_id, json.loads(line.removeprefix("data: "))


def test_events_tell_every_change_and_end_with_the_job(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202)
    job_id = made["job"]["id"]
    seen: list[tuple[str, str | None]] = []
    with admin.stream("GET", f"/v1/jobs/{job_id}/events") as answer:
        assert answer.headers["content-type"].startswith("text/event-stream")
        for _, job in _events(answer):
            seen.append((job["state"], job["stage"]))
            if seen == [("queued", None)]:
                by_hand.build(job_id)
    assert seen[0] == ("queued", None)
    assert seen[-1] == ("succeeded", None)


@pytest.mark.parametrize("last", ["", "nonsense", "-1", "999999999999999999999"])
def test_a_reconnect_with_any_id_works(admin: httpx.Client, by_hand: ByHand, last: str) -> None:
    job_id = _a_job(admin, by_hand, a_map(admin))
    ok(admin.post(f"/v1/jobs/{job_id}/cancel"), 202)
    answer = admin.get(f"/v1/jobs/{job_id}/events", headers={"Last-Event-ID": last})
    assert [job["state"] for _, job in _events(answer)] == ["cancelled"]


def test_a_reconnect_gets_only_what_is_new(admin: httpx.Client, by_hand: ByHand) -> None:
    job_id = _a_job(admin, by_hand, a_map(admin))
    with admin.stream("GET", f"/v1/jobs/{job_id}/events") as answer:
        last, job = next(_events(answer))
    assert job["state"] == "queued"
    later = threading.Timer(1.0, lambda: admin.post(f"/v1/jobs/{job_id}/cancel"))
    later.start()
    with admin.stream("GET", f"/v1/jobs/{job_id}/events", headers={"Last-Event-ID": last}) as answer:
        assert [job["state"] for _, job in _events(answer)] == ["cancelled"]
    later.join()
