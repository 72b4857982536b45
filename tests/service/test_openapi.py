"""The OpenAPI document: unchanged unless on purpose, and true."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings

from tests import web
from tests.server import Server
from tests.service.asking import ok
from tests.service.snapshot import SNAPSHOT, described

DOCUMENT = json.loads(SNAPSHOT.read_text(encoding="utf-8"))


def _operations(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            yield f"{method.upper()} {path}", operation


def test_the_document_is_the_snapshot() -> None:
    assert json.loads(described()) == DOCUMENT, "the API changed: if it was meant to, run `poe openapi`"


def test_the_service_gives_the_document(server: Server) -> None:
    assert ok(web.get(f"{server.url}/openapi.json")) == DOCUMENT


def test_every_operation_is_described() -> None:
    names = [operation["operationId"] for _, operation in _operations(DOCUMENT)]
    assert len(names) == len(set(names))
    for name, operation in _operations(DOCUMENT):
        assert len(operation["description"]) > 20, name
        assert "422" not in operation["responses"], name
        if name.startswith("HEAD "):
            assert not any("content" in answer for answer in operation["responses"].values()), name
            continue
        content = operation["responses"]["default"]["content"]
        assert content == {
            "application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}
        }, name
        succeeded = [status for status in operation["responses"] if status.startswith("2")]
        assert succeeded, name
    assert "HTTPValidationError" not in DOCUMENT["components"]["schemas"]


def _models(part: Any) -> Iterator[str]:
    """Give the title of every object with properties, wherever in the document it stands."""
    if isinstance(part, dict):
        if "properties" in part and isinstance(part.get("title"), str):
            yield part["title"]
        part = list(part.values())
    if isinstance(part, list):
        for inner in part:
            yield from _models(inner)


def test_no_two_schemas_share_a_title() -> None:
    schemas = DOCUMENT["components"]["schemas"]
    as_classes = [re.sub(r"\W|_", "", body["title"]).lower() for body in schemas.values()]
    assert len(set(as_classes)) == len(schemas)
    assert not [name for name in schemas if "__" in name], (
        "FastAPI tells classes of one name apart by modules"
    )
    titles = list(_models(DOCUMENT))
    assert sorted(titles) == sorted(set(titles))


def test_every_post_takes_an_idempotency_key() -> None:
    for name, operation in _operations(DOCUMENT):
        if name.startswith("POST "):
            headers = {p["name"].lower() for p in operation.get("parameters", []) if p["in"] == "header"}
            assert "idempotency-key" in headers, name


schema = schemathesis.openapi.from_dict(DOCUMENT)


@pytest.fixture(scope="module")
def admin_headers(server: Server) -> dict[str, str]:
    return {"Authorization": f"Bearer {server.admin_key}"}


# event streams do not end by themselves; pieces of uploads are no JSON and have tests of their own
@schema.exclude(path_regex="/events$|^/v1/tus/").parametrize()
@settings(
    max_examples=8,
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
    database=None,
)
def test_no_generated_request_makes_the_service_fail(
    case: schemathesis.Case, server: Server, admin_headers: dict[str, str]
) -> None:
    answer = case.call(base_url=server.url, headers=admin_headers)
    assert answer.status_code < 500, answer.text
    if answer.status_code >= 400 and case.method != "HEAD":
        assert answer.headers["content-type"] == ["application/problem+json"], answer.text
        assert answer.json()["status"] == answer.status_code
