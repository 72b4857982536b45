"""Every list and every thing of the running service: found in its OpenAPI document, none by hand."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import httpx
import pytest

from service.domain.plain import plain

_PARAMETER = re.compile(r"\{(\w+)\}$")
_ORIGIN = "(what a list told of it)"

Found = dict[str, Any]


@dataclass
class Look:
    """Hold what one look found: the templates that were asked, and the items of each list.

    Parameters
    ----------
    client : httpx.Client
        A client with an admin's key.
    is_plain : bool
        Whether all text has to be plain, as it is unless an earlier version stored it.
    """

    client: httpx.Client
    is_plain: bool = True
    asked: dict[str, int] = field(default_factory=dict)
    items: dict[str, list[tuple[Found, Found]]] = field(default_factory=dict)
    seen: dict[str, Found | None] = field(default_factory=dict)

    def everywhere(self) -> dict[str, int]:
        """Return how often each route that gives JSON was asked; each list and each thing answered 200.

        A route that gives neither (a comparison, a gate) may refuse, as the list of files of a revision that
        is not ready does; it must not fail. What comes is strict JSON of plain text.
        """
        return self._look(again=True)

    def news(self) -> dict[str, int]:
        """Return as `everywhere`, but ask again only for what belongs to things that are told otherwise."""
        return self._look(again=False)

    @cached_property
    def document(self) -> Found:
        """Return the service's description of itself."""
        document: Found = self.client.get("/openapi.json").json()
        return document

    def _look(self, *, again: bool) -> dict[str, int]:
        document = self.document
        routes = {path: ops["get"] for path, ops in document["paths"].items() if _gives_json(ops.get("get"))}
        self.items.clear()
        for path in sorted(routes, key=lambda path: (path.count("{"), path)):
            bindings, is_list = self.bindings(path), _is_list(routes[path], document)
            self.asked[path] = len(bindings)
            for bound in bindings:
                place, origin = path.format(**bound), bound.get(_ORIGIN)
                if origin is not None and not again and self.seen.get(place) == origin:
                    continue
                self.seen[place] = origin
                for told in self._pages(place, routes[path], is_thing=is_list or path[-1] == "}"):
                    listed = told.get("items", []) if is_list else []
                    self.items.setdefault(path.rpartition("/")[2], []).extend((bound, one) for one in listed)
        return self.asked

    def _pages(self, path: str, operation: Found, *, is_thing: bool) -> Iterator[Found]:
        needed = _required(operation)
        while True:
            answer = self.client.get(path, params=needed)
            may_refuse = answer.status_code < 500 and (not is_thing or "revision-not-ready" in answer.text)
            assert answer.status_code == 200 or may_refuse, f"{path}: {answer.status_code} {answer.text}"
            told = json.loads(answer.text, parse_constant=pytest.fail)
            assert not self.is_plain or plain(told) == told, path
            yield told
            if told.get("next_cursor") is None:
                return
            needed["cursor"] = told["next_cursor"]

    def bindings(self, path: str) -> list[Found]:
        """Return values of a path's parameters, as far as lists that were asked before have told them."""
        bindings: list[Found] = [{}]
        before = ""
        for segment in path.split("/"):
            parameter = _PARAMETER.match(segment)
            if parameter is not None:
                listed = self.items.get(before, [])
                bindings = [more for bound in bindings for more in _bound(bound, parameter[1], listed)]
            before = segment
        return bindings


def _bound(bound: Found, parameter: str, listed: list[tuple[Found, Found]]) -> Iterator[Found]:
    seen = set()
    for context, item in listed:
        told = {**item, **context}
        value = item[parameter] if parameter in item else item["id"]
        fits = all(told.get(name, given) == given for name, given in bound.items() if name != _ORIGIN)
        if fits and value not in seen:
            seen.add(value)
            yield {**bound, parameter: value, _ORIGIN: told}


def _gives_json(operation: Found | None) -> bool:
    return operation is not None and "application/json" in operation["responses"]["200"].get("content", {})


def _required(operation: Found) -> Found:
    """Return the query that a route demands, and the longest page."""
    asked = [one for one in operation.get("parameters", []) if one["in"] == "query"]
    needed = {one["name"]: _any_value(one["schema"]) for one in asked if one.get("required")}
    return needed | ({"limit": 200} if any(one["name"] == "limit" for one in asked) else {})


def _any_value(schema: Found) -> Any:
    if "enum" in schema:
        return schema["enum"][0]
    if schema.get("format") == "date-time":
        return "2026-01-01T00:00:00Z"
    return 1 if schema["type"] == "integer" else "manifest.json"


def _is_list(operation: Found, document: Found) -> bool:
    schema = operation["responses"]["200"]["content"]["application/json"]["schema"]
    if "$ref" in schema:
        schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return "items" in schema.get("properties", {})


def look_everywhere(client: httpx.Client, *, is_plain: bool = True) -> dict[str, int]:
    """Ask for every list and every thing by its id; return how often each route was asked."""
    return Look(client, is_plain).everywhere()
