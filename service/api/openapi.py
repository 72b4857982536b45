"""The OpenAPI document: what FastAPI derives, with its errors as they really are."""

from __future__ import annotations

from typing import Any

from fastapi import FastAPI
from fastapi.routing import APIRoute

from service.api.problems import MEDIA_TYPE
from service.api.schemas.base import Problem

PROBLEMS: dict[int | str, dict[str, Any]] = {
    "default": {
        "description": "A problem document (RFC 9457); its `type` leads to a page that explains it.",
        "model": Problem,
    }
}
"""The answer of every route when it does not do what was asked."""


def operation_id(route: APIRoute) -> str:
    """Return the name of a route's function: generated clients call it like this."""
    return route.name


def install(app: FastAPI) -> None:
    """Make `app` describe its errors as problem documents, and 422 as nothing else."""
    derive = app.openapi

    def described() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _corrected(derive())
        return app.openapi_schema

    app.openapi = described  # type: ignore[method-assign]  # FastAPI's documented way to extend it


def _corrected(schema: dict[str, Any]) -> dict[str, Any]:
    for path in schema["paths"].values():
        for method, operation in path.items():
            responses = operation["responses"]
            responses.pop("422", None)
            for body in operation.get("requestBody", {}).get("content", {}).values():
                body["schema"] = _without_null(body["schema"])
            for name, response in responses.items():
                if name == "default" and "content" in response:
                    response["content"] = {MEDIA_TYPE: next(iter(response["content"].values()))}
                if method == "head":
                    response.pop("content", None)
    for unused in ("HTTPValidationError", "ValidationError"):
        schema["components"]["schemas"].pop(unused, None)
    return schema


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a body that may be left out; generated clients fail where it may be null, too."""
    kinds = [kind for kind in schema.get("anyOf", []) if kind.get("type") != "null"]
    return kinds[0] if len(kinds) == 1 else schema
