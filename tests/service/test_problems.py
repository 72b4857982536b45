"""Refusals as problem documents, their pages, and what the framework itself would answer."""

from __future__ import annotations

import html
import json
import re

import httpx
import pytest

from service.api.problems import STATUSES, leaves, status_of
from service.domain.errors import DomainError, Unfulfilled
from tests import web
from tests.server import Server
from tests.service.asking import ok, refused
from tests.service.snapshot import SNAPSHOT


def test_every_refusal_has_a_page(server: Server) -> None:
    with web.Client(base_url=server.url) as client:
        for leaf in leaves():
            answer = client.get(f"/problems/{leaf.slug()}")
            assert answer.status_code == 200, leaf
            assert answer.headers["content-type"].startswith("text/html")
            assert leaf.title in html.unescape(answer.text)
            assert leaf.__doc__ is not None
            assert leaf.slug() in answer.text


def test_every_refusal_that_answers_has_a_status() -> None:
    slugs = [leaf.slug() for leaf in leaves()]
    assert len(slugs) == len(set(slugs))
    for leaf in leaves():
        assert (status_of(leaf) == 500) == issubclass(leaf, Unfulfilled), leaf
    assert all(issubclass(kind, DomainError) and 400 <= status < 600 for kind, status in STATUSES.items())


def test_what_is_not_there(server: Server, admin: httpx.Client) -> None:
    for path in (
        "/nothing",
        "/v2/maps",
        "/v1/maps/",
        "/problems/no-such",
        "/v1/%2e%2e/keys",
        "/" + "x" * 3000,
    ):
        answer = admin.get(path)
        assert answer.status_code == 404, path
        assert answer.headers["content-type"] == "application/problem+json"
        assert answer.json()["status"] == 404
    assert web.get(server.url + "/v1/maps%00").status_code == 422
    assert web.get(server.url + "/v1/maps?q=%00").status_code == 422


def test_a_wrong_method_is_told_the_right_ones(admin: httpx.Client) -> None:
    answer = admin.put("/v1/maps")
    assert answer.status_code == 405
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.headers["allow"] == "GET, HEAD, POST"
    assert admin.delete("/v1/maps/map_x").headers["allow"] == "GET, HEAD, PATCH"


def test_head_is_get_without_its_body(admin: httpx.Client, server: Server) -> None:
    paths = json.loads(SNAPSHOT.read_text(encoding="utf-8"))["paths"]
    streams = set()
    for path, methods in paths.items():
        if "get" not in methods:
            continue
        at = re.sub(r"\{n\}", "1", re.sub(r"\{(?!n\})\w+\}", "none", path))
        if "text/event-stream" in methods["get"]["responses"]["200"]["content"]:
            streams.add(path)
            head = admin.head(at)
            assert (head.status_code, head.headers["allow"]) == (405, "GET")
            continue
        got, head = admin.get(at), admin.head(at)
        assert (head.status_code, head.content) == (got.status_code, b""), path
        assert head.headers["content-type"] == got.headers["content-type"], path
        assert set(head.headers) == set(got.headers), path
        if path not in {"/metrics", "/v1/stats"}:
            assert head.headers["content-length"] == got.headers["content-length"], path
    assert len(streams) == 2
    for page in ("/", "/docs", "/tablet", "/problems/map-not-found", "/openapi.json"):
        assert web.head(server.url + page).status_code == 200
    assert web.head(server.url + "/v1/maps").status_code == 401
    counted = web.get(server.url + "/metrics").text
    assert re.search(r'method="HEAD".*route="/healthz"|route="/healthz".*method="HEAD"', counted)


def test_a_large_body_is_refused(server: Server, admin: httpx.Client) -> None:
    body = json.dumps({"site": "x" * 1_100_000, "name": "n"})
    answer = admin.post("/v1/maps", content=body, headers={"Content-Type": "application/json"})
    refused(answer, 413, "upload-too-large")
    assert answer.headers["x-request-id"]
    chunks = (b"[" * 1000 for _ in range(2000))
    refused(server.client(server.admin_key).post("/v1/maps", content=chunks), 413, "upload-too-large")


def _of_json() -> list[tuple[str, str]]:
    """Return method and path of every operation that takes JSON and nothing else."""
    paths = json.loads(SNAPSHOT.read_text(encoding="utf-8"))["paths"]
    return [
        (method.upper(), re.sub(r"\{n\}", "1", re.sub(r"\{(?!n\})\w+\}", "none", path)))
        for path, methods in paths.items()
        for method, operation in methods.items()
        if list(operation.get("requestBody", {}).get("content", {})) == ["application/json"]
    ]


@pytest.mark.parametrize("kind", ["text/plain", "application/x-www-form-urlencoded", "text/json", None])
def test_a_body_that_is_no_json_is_told_so(admin: httpx.Client, kind: str | None) -> None:
    asked = _of_json()
    assert len(asked) >= 15
    for method, path in asked:
        headers = {"X-Groundplan-Session": "1"} | ({} if kind is None else {"Content-Type": kind})
        answer = admin.request(method, path, content=b'{"site": "a"}', headers=headers)
        assert refused(answer, 415, "body-not-taken")["content_type"] == "application/json", path


def test_json_by_another_name_is_json(admin: httpx.Client) -> None:
    for kind in ("application/json; charset=utf-8", "Application/JSON", "application/vnd.plant+json"):
        answer = admin.post("/v1/maps", content=b"{}", headers={"Content-Type": kind})
        refused(answer, 422, "invalid-request")
    refused(admin.post("/v1/maps"), 422, "invalid-request")


def test_deeply_nested_json_is_refused(admin: httpx.Client) -> None:
    body = b"[" * 200_000
    answer = admin.post("/v1/maps", content=body, headers={"Content-Type": "application/json"})
    refused(answer, 422, "invalid-request")


def test_requests_have_ids(admin: httpx.Client, server: Server) -> None:
    given = admin.get("/v1/maps", headers={"X-Request-Id": "abc-123"})
    assert given.headers["x-request-id"] == "abc-123"
    made = [admin.get("/nowhere").headers["x-request-id"] for _ in range(2)]
    assert made[0] != made[1]
    assert "abc-123" in server.log.read_text(encoding="utf-8")


def test_the_log_holds_no_secret(server: Server, admin: httpx.Client) -> None:
    made = ok(admin.post("/v1/keys", json={"name": "logged", "role": "robot"}), 201)
    ok(server.client(made["key"]).get("/v1/maps"))
    log = server.log.read_text(encoding="utf-8")
    assert made["key"] not in log
    assert server.admin_key not in log


@pytest.mark.parametrize("path", ["/healthz", "/readyz"])
def test_the_service_says_how_it_is(server: Server, path: str) -> None:
    assert ok(web.get(server.url + path))["status"] == "ok"


def test_metrics_count_requests_and_jobs(server: Server, admin: httpx.Client) -> None:
    ok(admin.get("/v1/maps"))
    text = web.get(server.url + "/metrics").text
    assert 'groundplan_http_requests_total{method="GET",route="/v1/maps",status="200"}' in text
    assert 'groundplan_jobs{state="queued"} 0.0' in text
    assert "groundplan_queue_age_seconds 0.0" in text


def test_stats_add_up(admin: httpx.Client) -> None:
    before = ok(admin.get("/v1/stats"))
    ok(admin.post("/v1/maps", json={"site": "Stats", "name": "one"}), 201)
    after = ok(admin.get("/v1/stats"))
    assert after["totals"]["maps"] == before["totals"]["maps"] + 1
    assert set(after["jobs"]) == {"queued", "running", "succeeded", "failed", "cancelled"}
    assert after["free_bytes"] > 0
