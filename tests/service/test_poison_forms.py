"""Text that is none, in every form, query, path and header of the API: it harms nobody."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests import poison
from tests.every_list import Found, Look, look_everywhere
from tests.server import Server
from tests.service.asking import ok

QUERIES = ("%00", "%ED%A0%80", "%1B%5B2J", "%FF", "%C2%9B", "%EF%BF%BE")
JSON = "application/json"


def _filled(schema: Found, document: Found, text: str) -> Any:
    """Return a value of a schema in which every text that may be any is `text`."""

    def inner(one: Found) -> Any:
        return _filled(one, document, text)

    if "$ref" in schema:
        return inner(document["components"]["schemas"][schema["$ref"].rpartition("/")[2]])
    for choices in ("anyOf", "oneOf", "allOf"):
        if choices in schema:
            return inner(schema[choices][0])
    if "const" in schema or "enum" in schema:
        return schema.get("const", schema.get("enum", [None])[0])
    if schema.get("type") == "object":
        return {n: inner(one) for n, one in schema.get("properties", {}).items()} or {text: text}
    if schema.get("type") == "array":
        return [inner(schema["items"])] * max(1, schema.get("minItems", 1))
    simple = {"integer": schema.get("minimum", 1), "number": schema.get("minimum", 1), "boolean": True}
    return simple.get(schema.get("type", "string"), text)


def _forms(document: Found) -> Iterator[tuple[str, str, Found]]:
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            content = operation.get("requestBody", {}).get("content", {})
            if JSON in content:
                yield method, path, content[JSON]["schema"]


@pytest.mark.parametrize("text", poison.TEXTS, ids=ascii)
def test_no_text_in_a_form_fails_the_service_or_poisons_a_list(planted: Server, text: str) -> None:
    client = planted.client(planted.admin_key)
    document, look, answered = client.get("/openapi.json").json(), Look(client), dict[str, set[int]]()
    look.everywhere()
    for method, path, schema in _forms(document):
        whole = _filled(schema, document, text)
        bodies = [
            whole,
            {text: text},
            {**whole, text: text},
            [text],
            text,
            *({n: v} for n, v in whole.items()),
        ]
        for body in bodies:
            for bound in look.bindings(path)[:1]:
                answer = client.request(
                    method, path.format(**bound), content=json.dumps(body), headers={"Content-Type": JSON}
                )
                assert answer.status_code < 500, (method, path, body, answer.text)
                answered.setdefault(f"{method} {path}", set()).add(answer.status_code)
    assert set(answered) == {f"{method} {path}" for method, path, _ in _forms(document)}
    look_everywhere(client)


def _written(map_id: str, robot_id: str, text: str) -> list[tuple[str, str, Found]]:
    """Return the forms in which people write what they want, filled with a text."""
    return [
        ("POST", "/v1/maps", {"site": "Plant", "name": f"{text}1"}),
        ("PATCH", f"/v1/maps/{map_id}", {"name": f"{text}2"}),
        ("POST", "/v1/keys", {"name": text, "role": "tablet"}),
        ("POST", "/v1/robots", {"name": text, "map_id": map_id}),
        ("PATCH", f"/v1/robots/{robot_id}", {"name": text}),
        ("POST", f"/v1/robots/{robot_id}/reports", {"state": "failed", "revision": 1, "detail": text}),
        ("POST", f"/v1/maps/{map_id}/revisions", {"base": 2, "drawing_id": None, "reason": text}),
        ("POST", f"/v1/maps/{map_id}/revisions/1/publish", {"channel": "trial", "reason": text}),
    ]


def test_what_people_write_is_text(planted: Server) -> None:
    client = planted.client(planted.admin_key)
    look = Look(client)
    look.everywhere()
    map_id, robot_id = look.items["maps"][0][1]["id"], look.items["robots"][0][1]["id"]
    for text in ("a plain text", *poison.TEXTS):
        for method, path, body in _written(map_id, robot_id, text):
            answer = client.request(method, path, content=json.dumps(body), headers={"Content-Type": JSON})
            is_granted = 200 <= answer.status_code < 300
            assert is_granted or answer.status_code == 422, (path, answer.text)
            assert is_granted or text != "a plain text", (path, answer.text)
        look_everywhere(client)


def test_no_text_in_a_query_fails_the_service(planted: Server) -> None:
    client = planted.client(planted.admin_key)
    document, look = client.get("/openapi.json").json(), Look(client)
    look.everywhere()
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            names = [one["name"] for one in operation.get("parameters", []) if one["in"] == "query"]
            is_stream = "text/event-stream" in str(operation["responses"])
            for bound in [] if is_stream else look.bindings(path)[:1]:
                for name, text in itertools.product(names, QUERIES):
                    answer = client.request(method, f"{path.format(**bound)}?{name}={text}")
                    assert answer.status_code < 500, (path, name, text, answer.text)
    look_everywhere(client)


def test_no_text_in_a_path_fails_the_service(planted: Server) -> None:
    client = planted.client(planted.admin_key)
    for path, operations in client.get("/openapi.json").json()["paths"].items():
        names = re.findall(r"\{(\w+)\}", path)
        for text, method in itertools.product(QUERIES if names else (), operations):
            answer = client.request(method, path.format(**dict.fromkeys(names, text)))
            assert answer.status_code < 500, (method, path, text, answer.text)
    look_everywhere(client)


@pytest.mark.parametrize(
    "header", ["Idempotency-Key", "X-Request-Id", "User-Agent", "If-None-Match", "Authorization"]
)
def test_no_header_fails_the_service(planted: Server, header: str) -> None:
    client = planted.client(planted.admin_key)
    for n, value in enumerate((b"\xff\xfe", b"\xed\xa0\x80", b"\x9b[2J", b"\xc2\x85")):
        answer = client.post(
            "/v1/maps", json={"site": "h", "name": f"{header} {n}"}, headers=[(header.encode(), value)]
        )
        assert answer.status_code < 500, answer.text
    look_everywhere(client)
    assert ok(client.get("/v1/maps"))["items"]
