"""How many requests a key may send: counted before anything is done for them, and told with every answer."""

from __future__ import annotations

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.auth import presented_secret
from service.api.edge import POLICY, request_id_of
from service.api.metrics import Metrics
from service.api.problems import answer, base_url_of
from service.api.windows import WINDOW_S, Windows
from service.domain.errors import TooManyRequests
from service.usecases.keys import secret_digest


class Rates:
    """Wrap an ASGI app: a key's requests are counted over a sliding minute, and refused past the limit.

    Counted is the key that the routes would read, valid or not, so that nothing has to be looked up; requests
    without one are not. Each service process counts for itself.

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
        self._windows = Windows(most=per_minute)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        secret = await presented_secret(scope) if scope["type"] == "http" else None
        if secret is None:
            await self.app(scope, receive, send)
            return
        counted, most = self._windows.hit(secret_digest(secret)), self._windows.most
        told = [  # as the IETF's draft of the RateLimit fields says it
            (b"ratelimit-policy", f'"key";q={most};w={WINDOW_S}'.encode()),
            (b"ratelimit", f'"key";r={counted.left};t={counted.more_in_s}'.encode()),
        ]

        async def send_told(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), *told]
            await send(message)

        if counted.is_within:
            await self.app(scope, receive, send_told)
            return
        refusal = TooManyRequests(
            f"The key has sent {most} requests within a minute, the most that are answered.",
            retry_after_s=counted.more_in_s,
        )
        response = answer(refusal, base_url=base_url_of(Request(scope)))
        response.headers["Content-Security-Policy"] = POLICY.decode()
        response.headers["X-Request-Id"] = request_id_of(scope)
        await response(scope, receive, send_told)
        self.metrics.count(scope["method"], "refused", status=response.status_code, seconds=0.0)
