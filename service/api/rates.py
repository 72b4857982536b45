"""How many requests a key may send: counted before anything is done for them, and told with every answer."""

from __future__ import annotations

import math
import re
import time
from http.cookies import CookieError, SimpleCookie

from limits import RateLimitItemPerMinute
from limits.storage import MemoryStorage
from limits.strategies import SlidingWindowCounterRateLimiter
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.auth import SESSION_COOKIE
from service.api.edge import POLICY, request_id_of
from service.api.metrics import Metrics
from service.api.problems import answer, base_url_of
from service.domain.errors import TooManyRequests
from service.usecases.keys import secret_digest

_WINDOW_S = 60
_BEARER = re.compile(rb"[Bb]earer +([\x21-\x7e]+)")


class Rates:
    """Wrap an ASGI app: a key's requests are counted over a sliding minute, and refused past the limit.

    Counted is what was presented, valid or not, so that nothing has to be looked up; requests without a key
    are not. Each service process counts for itself.

    Parameters
    ----------
    app : ASGI application
        What answers.
    per_minute : int
        Most requests of one key in a minute.
    metrics : Metrics
        Where refusals are counted.
    """

    def __init__(self, app: ASGIApp, *, per_minute: int, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics
        self._item = RateLimitItemPerMinute(per_minute)
        self._limiter = SlidingWindowCounterRateLimiter(MemoryStorage())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        secret = _presented(scope) if scope["type"] == "http" else None
        if secret is None:
            await self.app(scope, receive, send)
            return
        key = secret_digest(secret)
        is_within = self._limiter.hit(self._item, key)
        told = self._headers(key)

        async def send_told(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *told]
            await send(message)

        if is_within:
            await self.app(scope, receive, send_told)
            return
        refusal = TooManyRequests(
            f"The key has sent {self._item.amount} requests within a minute, the most that are answered.",
            retry_after_s=self._wait_s(key),
        )
        response = answer(refusal, base_url=base_url_of(Request(scope)))
        response.headers["Content-Security-Policy"] = POLICY.decode()
        response.headers["X-Request-Id"] = request_id_of(scope)
        await response(scope, receive, send_told)
        self.metrics.count(scope["method"], "refused", status=response.status_code, seconds=0.0)

    def _wait_s(self, key: str) -> int:
        until = self._limiter.get_window_stats(self._item, key).reset_time
        return max(1, math.ceil(until - time.time()))

    def _headers(self, key: str) -> list[tuple[bytes, bytes]]:
        """Return what is left, as the IETF's draft of the RateLimit fields says it."""
        left = self._limiter.get_window_stats(self._item, key).remaining
        policy = f'"key";q={self._item.amount};w={_WINDOW_S}'
        return [
            (b"ratelimit-policy", policy.encode()),
            (b"ratelimit", f'"key";r={left};t={self._wait_s(key)}'.encode()),
        ]


def _presented(scope: Scope) -> str | None:
    """Return the key that a request presents, as bearer or in the session's cookie."""
    headers = dict(scope["headers"])
    bearer = _BEARER.fullmatch(headers.get(b"authorization", b""))
    if bearer is not None:
        return bearer[1].decode("ascii")
    try:
        cookie = SimpleCookie(headers.get(b"cookie", b"").decode("latin-1")).get(SESSION_COOKIE)
    except CookieError:
        return None
    return None if cookie is None else cookie.value
