"""Answers that come before the end of the request's body still reach a client that is busy sending."""

from __future__ import annotations

import asyncio

from starlette.types import ASGIApp, Message, Receive, Scope, Send

MAX_BYTES = 64 << 20
MAX_S = 10.0


class Drain:
    """Wrap an ASGI app: after an early answer, take what the client still sends for a while, then close.

    A server that closes a connection while bytes are on their way makes the kernel reset it, and the client
    may lose the answer that had been sent. So the answer goes out at once, with ``Connection: close``; then
    up to `max_bytes` and `max_s` of the rest are read and thrown away. A client that waits for
    ``100 Continue`` has sent nothing and is not waited for.

    Parameters
    ----------
    app : ASGI application
        What answers.
    max_bytes : int
        Most bytes that are thrown away.
    max_s : float
        Most seconds that they may take.
    """

    def __init__(self, app: ASGIApp, *, max_bytes: int = MAX_BYTES, max_s: float = MAX_S) -> None:
        self.app = app
        self.max_bytes = max_bytes
        self.max_s = max_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or not _has_body(scope):
            await self.app(scope, receive, send)
            return
        body = _Body(receive, begun=not _waits_for_continue(scope))

        async def send_and_drain(message: Message) -> None:
            if message["type"] == "http.response.start" and not body.ended:
                message["headers"] = [*message.get("headers", []), (b"connection", b"close")]
            is_last = message["type"] == "http.response.body" and not message.get("more_body", False)
            if is_last and not body.ended and body.begun:
                await send({**message, "more_body": True})
                await body.drain(max_bytes=self.max_bytes, max_s=self.max_s)
                message = {"type": "http.response.body", "body": b""}
            await send(message)

        await self.app(scope, body.receive, send_and_drain)


class _Body:
    """The body of one request, watched as it is read."""

    def __init__(self, receive: Receive, *, begun: bool) -> None:
        self._receive = receive
        self.begun = begun
        self.ended = False

    async def receive(self) -> Message:
        self.begun = True
        message = await self._receive()
        self.ended = message["type"] == "http.disconnect" or not message.get("more_body", False)
        return message

    async def drain(self, *, max_bytes: int, max_s: float) -> None:
        try:
            async with asyncio.timeout(max_s):
                while not self.ended and max_bytes > 0:
                    message = await self.receive()
                    max_bytes -= len(message.get("body", b""))
        except TimeoutError:
            return


def _has_body(scope: Scope) -> bool:
    for name, value in scope["headers"]:
        if name == b"transfer-encoding" or (name == b"content-length" and value != b"0"):
            return True
    return False


def _waits_for_continue(scope: Scope) -> bool:
    return any(name == b"expect" and value.lower() == b"100-continue" for name, value in scope["headers"])
