"""The outermost layer: a request id, one log line a request, counters, and paths that no database takes."""

from __future__ import annotations

import re
import secrets
import time
from typing import Any

import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.metrics import Metrics
from service.api.problems import answer
from service.domain.errors import InvalidRequest

_REQUEST_ID = re.compile(rb"[\x21-\x7e]{1,100}")


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
        request_id = _request_id(scope)
        status = 500
        begun = time.perf_counter()

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message["headers"], (b"x-request-id", request_id.encode())]
            await send(message)

        with structlog.contextvars.bound_contextvars(request_id=request_id):
            try:
                if _holds_nul(scope):
                    refusal = InvalidRequest(
                        "The address holds a NUL character.",
                        errors=[{"parameter": "path", "detail": "NUL is allowed nowhere."}],
                    )
                    await answer(refusal, base_url="")(scope, receive, send_with_id)
                else:
                    await self.app(scope, receive, send_with_id)
            finally:
                self._record(scope, status=status, seconds=time.perf_counter() - begun)

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


def _request_id(scope: Scope) -> str:
    given = next((value for name, value in scope["headers"] if name == b"x-request-id"), b"")
    return given.decode() if _REQUEST_ID.fullmatch(given) else secrets.token_hex(8)


def _holds_nul(scope: Scope) -> bool:
    return "\x00" in scope["path"] or b"%00" in scope.get("query_string", b"")
