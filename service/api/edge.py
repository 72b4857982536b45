"""The outermost layer: a request id, a policy, one log line a request, counters, and no NUL in a path."""

from __future__ import annotations

import re
import secrets
import time
from typing import Any

import structlog
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.metrics import Metrics
from service.api.problems import answer, base_url_of
from service.domain.errors import DomainError, InvalidRequest, UploadTooLarge

_TOO_LARGE = 413
POLICY = b"default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""Of every answer that has no policy of its own: nothing in a file or a problem's page may load or run."""
_REQUEST_ID = re.compile(rb"[\x21-\x7e]{1,100}")


class _Sent:
    """Pass on what is sent, with request id and policy; hold back the framework's answer to a large body."""

    def __init__(self, send: Send, request_id: str) -> None:
        self._send = send
        self._request_id = request_id
        self.status = 0
        self.withheld = False

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.withheld = message["status"] == _TOO_LARGE and _is_plain_text(message)
        if not self.withheld:
            await self.send_as_is(message)

    async def send_as_is(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.status = message["status"]
            told = [*message["headers"], (b"x-request-id", self._request_id.encode())]
            if not any(name == b"content-security-policy" for name, _ in told):
                told.append((b"content-security-policy", POLICY))
            message["headers"] = told
        await self._send(message)


class Edge:
    """Wrap an ASGI app; pure ASGI, so that bodies stream through untouched.

    Parameters
    ----------
    app : ASGI application
        What answers.
    metrics : Metrics
        Where requests are counted.
    """

    def __init__(self, app: ASGIApp, *, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request_id = request_id_of(scope)
        sent = _Sent(send, request_id)
        begun = time.perf_counter()
        with structlog.contextvars.bound_contextvars(request_id=request_id):
            try:
                await self._answer(scope, receive, sent)
            except Exception as error:
                if not sent.status:
                    raise
                structlog.get_logger("service.access").debug("answered-defect", cause=repr(error))
            finally:
                self._record(scope, status=sent.status or 500, seconds=time.perf_counter() - begun)

    async def _answer(self, scope: Scope, receive: Receive, sent: _Sent) -> None:
        base_url = base_url_of(Request(scope))
        if _holds_nul(scope):
            place = {"parameter": "path", "detail": "NUL is allowed nowhere."}
            refusal: DomainError = InvalidRequest("The address holds a NUL character.", errors=[place])
        else:
            await self.app(scope, receive, sent)
            if not sent.withheld:
                return
            refusal = UploadTooLarge("The body is larger than this route takes.")
        await answer(refusal, base_url=base_url)(scope, receive, sent.send_as_is)

    def _record(self, scope: Scope, *, status: int, seconds: float) -> None:
        route: Any = scope.get("route")
        pattern = getattr(route, "path", "unmatched")
        self.metrics.count(scope["method"], pattern, status=status, seconds=seconds)
        structlog.get_logger("service.access").info(
            "request",
            method=scope["method"],
            path=scope["path"],
            status=status,
            ms=round(seconds * 1000, 1),
        )


def request_id_of(scope: Scope) -> str:
    """Return the id that the client gave its request, or a new one."""
    given = next((value for name, value in scope["headers"] if name == b"x-request-id"), b"")
    return given.decode() if _REQUEST_ID.fullmatch(given) else secrets.token_hex(8)


def _is_plain_text(message: Message) -> bool:
    return any(k == b"content-type" and v.startswith(b"text/plain") for k, v in message["headers"])


def _holds_nul(scope: Scope) -> bool:
    return "\x00" in scope["path"] or b"%00" in scope.get("query_string", b"")
