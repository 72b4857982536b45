"""The API's description names what its members hold: of free-form JSON there are few, each for a reason."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from tests.service.snapshot import SNAPSHOT

DOCUMENT = json.loads(SNAPSHOT.read_text(encoding="utf-8"))
SCHEMAS = DOCUMENT["components"]["schemas"]

ALLOWED = {
    "AuditEntryOut.before": "each action keeps what it changed; the log outlives every schema",
    "AuditEntryOut.after": "as before",
    "DifferenceOut.before": "what a state had of the subject, a thing of its own for each kind of subject",
    "DifferenceOut.after": "as before",
    "DeliveryOut.body": "the very body that was sent, of whatever version sent it",
}
AT_MOST = 5


def is_free(schema: Mapping[str, Any]) -> bool:
    """Return whether a schema, or one within it, says no more than that it is JSON, an object or a list."""
    if "$ref" in schema:
        return False  # its members are counted where it stands
    forms = [*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())]
    if forms:
        return any(is_free(form) for form in forms)
    if "enum" in schema or "const" in schema:
        return False
    if schema.get("type") == "array":
        parts = [*schema.get("prefixItems", ()), *([schema["items"]] if "items" in schema else ())]
        return not parts or any(part is True or is_free(part) for part in parts)
    if schema.get("type") == "object":
        inner = list(schema.get("properties", {}).values())
        more = schema.get("additionalProperties", not inner)
        return more is True or any(is_free(one) for one in inner) or (more is not False and is_free(more))
    return "type" not in schema


def members() -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Give every member of every schema by its name; a schema without members is one itself."""
    for name, schema in SCHEMAS.items():
        if "properties" not in schema:
            yield name, schema
        for member, form in schema.get("properties", {}).items():
            yield f"{name}.{member}", form


def test_the_members_of_free_form_are_those_named_here() -> None:
    every = dict(members())
    free = {name for name, form in every.items() if is_free(form)}
    assert free == set(ALLOWED), f"{len(free)} of {len(every)} members are free-form"
    assert len(free) <= AT_MOST


def test_problems_alone_have_members_of_any_name() -> None:
    open_ = {name for name, schema in SCHEMAS.items() if schema.get("additionalProperties") is True}
    assert open_ == {"Problem"}, "RFC 9457 lets a problem's type add members of its own"


@pytest.mark.parametrize(
    ("schema", "free"),
    [
        ({}, True),
        ({"title": "Anything"}, True),
        ({"type": "object"}, True),
        ({"type": "object", "additionalProperties": True}, True),
        ({"type": "object", "additionalProperties": {}}, True),
        ({"type": "object", "additionalProperties": {"type": "number"}}, False),
        ({"type": "object", "properties": {"a": {}}}, True),
        ({"type": "array"}, True),
        ({"type": "array", "items": {}}, True),
        ({"type": "array", "items": {"type": "object", "additionalProperties": True}}, True),
        ({"type": "array", "items": {"type": "array", "items": {"type": "number"}}}, False),
        ({"anyOf": [{"type": "object"}, {"type": "null"}]}, True),
        ({"anyOf": [{"$ref": "#/x"}, {"type": "null"}]}, False),
        ({"type": ["string", "null"]}, False),
    ],
)
def test_what_counts_as_free(schema: dict[str, Any], free: bool) -> None:  # noqa: FBT001 - a case
    assert is_free(schema) is free
