"""The way of a poll that finds nothing new: 304 from memory, before any routing."""

from __future__ import annotations

import re
import time

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.auth import presented_secret
from service.api.conditions import none_match
from service.api.edge import request_id_of
from service.api.metrics import Metrics
from service.api.polling import Polling

ROUTE = "/v1/maps/{map_id}/published"
POINTER_CACHING = "private, no-cache"

_PATH = re.compile(r"/v1/maps/([a-z]+_[0-9a-z]{1,39})/published")
_QUERY = re.compile(rb"(?:channel=([a-z][a-z0-9-]{0,39}))?")


class Unchanged:
    """Wrap an ASGI app: a poll whose `If-None-Match` still holds is answered here, all else by the app.

    Thousands of robots ask the same again and again, and nearly always nothing has changed. Such an answer
    is counted like every other, and not logged.

    Parameters
    ----------
    app : ASGI application
        What answers everything else.
    polling : Polling
        What is known without the database.
    metrics : Metrics
        Where requests are counted.
    """

    def __init__(self, app: ASGIApp, *, polling: Polling, metrics: Metrics) -> None:
        self.app = app
        self.polling = polling
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        asked = _asked(scope)
        if asked is None:
            await self.app(scope, receive, send)
            return
        begun = time.perf_counter()
        headers = Headers(scope=scope)
        held, secret = headers.get("if-none-match"), await presented_secret(scope)
        tag = None
        if held is not None and secret is not None and "if-match" not in headers:
            tag = await self.polling.tag(secret, *asked)
        if held is None or tag is None or none_match(held, tag):
            await self.app(scope, receive, send)
            return
        told = [
            (b"etag", f'"{tag}"'.encode()),
            (b"cache-control", POINTER_CACHING.encode()),
            (b"x-request-id", request_id_of(scope).encode()),
        ]
        await send({"type": "http.response.start", "status": 304, "headers": told})
        await send({"type": "http.response.body", "body": b""})
        self.metrics.count(scope["method"], ROUTE, status=304, seconds=time.perf_counter() - begun)


def _asked(scope: Scope) -> tuple[str, str | None] | None:
    """Return the map and the channel that the request asks for, or None when it is no plain poll."""
    if scope["type"] != "http" or scope["method"] not in {"GET", "HEAD"}:
        return None
    path, query = _PATH.fullmatch(scope["path"]), _QUERY.fullmatch(scope["query_string"])
    if path is None or query is None:
        return None
    return path[1], None if query[1] is None else query[1].decode("ascii")
