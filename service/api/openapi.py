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
        for operation in path.values():
            responses = operation["responses"]
            responses.pop("422", None)
            for name, response in responses.items():
                if name == "default" and "content" in response:
                    response["content"] = {MEDIA_TYPE: next(iter(response["content"].values()))}
    for unused in ("HTTPValidationError", "ValidationError"):
        schema["components"]["schemas"].pop(unused, None)
    return schema
