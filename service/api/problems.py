"""Refusals and failures as RFC 9457 problem documents: the one place that knows HTTP statuses of errors."""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Iterator, Mapping
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse
from starlette.exceptions import HTTPException
from starlette.responses import Response

from service.api.addresses import Addresses
from service.api.methods import methods_at
from service.domain.errors import (
    BodyNotTaken,
    ChecksumMismatch,
    ChecksumUnsupported,
    CodingNotOffered,
    Conflict,
    DatabaseBusy,
    DomainError,
    FileIsAnother,
    Forbidden,
    InvalidRequest,
    LinkNotValid,
    NotFound,
    OriginNotProven,
    PointerMoved,
    Rejected,
    StorageFull,
    TooManyRequests,
    TooManyStreams,
    TusExtensionNotOffered,
    TusVersionUnsupported,
    Unauthenticated,
    Unavailable,
    Unfulfilled,
    UnsupportedMedia,
    UploadBusy,
    UploadExpired,
    UploadInterrupted,
    UploadTooLarge,
)

MEDIA_TYPE = "application/problem+json"
PAGES = "/problems/"
_RETRY_AFTER_S = 2

STATUSES: Mapping[type[DomainError], int] = {
    Unauthenticated: 401,
    Forbidden: 403,
    LinkNotValid: 403,
    OriginNotProven: 403,
    NotFound: 404,
    UploadExpired: 410,
    CodingNotOffered: 406,
    UploadBusy: 423,
    FileIsAnother: 412,
    PointerMoved: 412,
    Conflict: 409,
    UploadTooLarge: 413,
    BodyNotTaken: 415,
    UnsupportedMedia: 415,
    UploadInterrupted: 408,
    ChecksumMismatch: 460,
    ChecksumUnsupported: 400,
    TusExtensionNotOffered: 400,
    TusVersionUnsupported: 412,
    Rejected: 422,
    StorageFull: 507,
    TooManyRequests: 429,
    TooManyStreams: 429,
    Unavailable: 503,
}
"""Status of each branch or leaf; of several that fit, the nearest in the class's own line holds.

`Unfulfilled` has none: it is how a job ends, never how a request is answered.
"""


def leaves(branch: type[DomainError] = DomainError) -> Iterator[type[DomainError]]:
    """Give every refusal that can occur: the classes without subclasses."""
    for child in branch.__subclasses__():
        if child.__subclasses__():
            yield from leaves(child)
        else:
            yield child


def status_of(kind: type[DomainError]) -> int:
    """Return the HTTP status of a refusal; 500 for what must never answer a request."""
    return next((STATUSES[base] for base in kind.__mro__ if base in STATUSES), 500)


def document(problem: Mapping[str, Any], *, base_url: str) -> dict[str, Any]:
    """Return a stored problem (with its ``slug``) as a problem document with its ``type`` URL."""
    members = dict(problem)
    slug = members.pop("slug")
    return {"type": f"{base_url}{PAGES}{slug}", **members}


def answer(error: DomainError, *, base_url: str) -> Response:
    """Return the HTTP answer to a refusal."""
    status = status_of(type(error))
    headers: dict[str, str] = {}
    if isinstance(error, Unauthenticated):
        headers["WWW-Authenticate"] = 'Bearer realm="groundplan"'
    if isinstance(error, Unavailable):
        headers["Retry-After"] = str(error.members.get("retry_after_s", _RETRY_AFTER_S))
    body = document(error.problem(), base_url=base_url)
    return _problem(body | {"status": status}, status=status, headers=headers)


def page(slug: str) -> HTMLResponse | None:
    """Return the public page of a refusal, from its class; None when no refusal has this slug."""
    kind = next((leaf for leaf in leaves() if leaf.slug() == slug), None)
    if kind is None:
        return None
    status = f"HTTP status {status_of(kind)}" if not issubclass(kind, Unfulfilled) else "outcome of a job"
    paragraphs = "".join(
        f"<p>{_with_code(part)}</p>" for part in inspect.cleandoc(kind.__doc__ or "").split("\n\n")
    )
    title = html.escape(kind.title)
    return HTMLResponse(
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title></head>'
        f"<body><h1>{title}</h1><p><code>{slug}</code>, {status}</p>{paragraphs}</body></html>"
    )


def _with_code(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text, quote=False))


def install(app: FastAPI) -> None:
    """Answer every refusal, every mistake in a request and every defect of `app` with a problem document."""
    app.add_exception_handler(DomainError, _on_refusal)
    app.add_exception_handler(RequestValidationError, _on_invalid)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_defect)


def base_url_of(request: Request) -> str:
    """Return the address under which the client reaches this service, without a slash at its end."""
    addresses: Addresses = request.app.state.addresses
    return addresses.base_url(request.scope)


async def _on_refusal(request: Request, error: Exception) -> Response:
    assert isinstance(error, DomainError)
    if isinstance(error, DatabaseBusy):
        structlog.get_logger("service.api").warning("database-busy", cause=repr(error.__cause__))
    if status_of(type(error)) >= 500 and not isinstance(error, Unavailable):
        return await _on_defect(request, error)
    return answer(error, base_url=base_url_of(request))


async def _on_invalid(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    if isinstance(error.body, bytes) and error.body:  # FastAPI leaves what is said to be no JSON as it is
        return answer(_not_json(request), base_url=base_url_of(request))
    places = [_place(found) for found in error.errors()]
    first = places[0]
    detail = f"{first.get('pointer') or first.get('parameter') or first.get('header')}: {first['detail']}"
    if len(places) > 1:
        detail += f" ({len(places) - 1} more in errors)"
    return answer(InvalidRequest(detail, errors=places), base_url=base_url_of(request))


def _not_json(request: Request) -> BodyNotTaken:
    given = request.headers.get("content-type")
    said = "has no Content-Type" if given is None else f"is said to be {given[:100]!r}"
    return BodyNotTaken(
        f"The body {said}; {request.url.path} takes application/json.", content_type="application/json"
    )


def _place(found: Mapping[str, Any]) -> dict[str, str]:
    where, *path = found["loc"]
    detail = str(found["msg"]).removeprefix("Value error, ")
    if where in {"query", "path"}:
        return {"parameter": str(path[0]), "detail": detail}
    if where == "header":
        return {"header": str(path[0]), "detail": detail}
    if found["type"] == "json_invalid":
        return {"pointer": "#", "detail": f"The body is no JSON: {found['ctx']['error']}."}
    escaped = (str(part).replace("~", "~0").replace("/", "~1") for part in path)
    return {"pointer": "#" + "".join(f"/{part}" for part in escaped), "detail": detail}


async def _on_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    if error.status_code == 413:
        limit = f"The body is larger than this route takes: {error.detail}."
        return answer(UploadTooLarge(limit), base_url=base_url_of(request))
    if error.status_code in {400, 422}:
        return answer(
            InvalidRequest(str(error.detail), errors=[{"pointer": "#", "detail": str(error.detail)}]),
            base_url=base_url_of(request),
        )
    sentence = {
        404: f"There is nothing at {request.url.path}.",
        405: f"{request.url.path} does not take {request.method}; `Allow` lists what it takes.",
    }.get(error.status_code, str(error.detail))
    headers = dict(error.headers or {})
    if error.status_code == 405:
        headers["Allow"] = ", ".join(sorted(methods_at(request)))
    body = {
        "type": "about:blank",
        "title": HTTPStatus(error.status_code).phrase,
        "status": error.status_code,
        "detail": sentence,
    }
    return _problem(body, status=error.status_code, headers=headers)


async def _on_defect(request: Request, error: Exception) -> Response:
    structlog.get_logger("service.api").error(
        "defect", method=request.method, path=request.url.path, exc_info=error
    )
    body = {
        "type": "about:blank",
        "title": "Internal Server Error",
        "status": 500,
        "detail": "The service failed; the fault is on its side and stands in its log under the request id.",
    }
    return _problem(body, status=500, headers=None)


def _problem(body: Mapping[str, Any], *, status: int, headers: Mapping[str, str] | None) -> Response:
    return JSONResponse(body, status_code=status, headers=headers, media_type=MEDIA_TYPE)
