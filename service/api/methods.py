"""Which methods an address takes; HEAD is everywhere where GET is, but for streams, which have no end."""

from __future__ import annotations

from starlette.requests import Request
from starlette.routing import BaseRoute, Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send


def methods_at(request: Request) -> set[str]:
    """Return every method that some route takes at the request's path: one route alone knows only its own."""
    methods: set[str] = set()
    for route in _routes_at(request):
        own = getattr(route, "methods", None) or set()
        methods |= own
        if "GET" in own and not _streams(route):
            methods.add("HEAD")
    return methods


class Heads:
    """Answer HEAD by the headers of GET, where a route has no HEAD of its own (RFC 9110, 9.3.2).

    Parameters
    ----------
    app : ASGI application
        What answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http" or scope["method"] != "HEAD" or not _only_has_get(Request(scope)):
            await self.app(scope, receive, send)
            return
        as_get = dict(scope, method="GET")
        try:
            await self.app(as_get, receive, _without_body(send))
        finally:
            scope["route"] = as_get.get("route")


def _without_body(send: Send) -> Send:
    async def send_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            await send(message)
        elif not message.get("more_body", False):
            await send({"type": "http.response.body", "body": b"", "more_body": False})

    return send_headers


def _only_has_get(request: Request) -> bool:
    own = {method for route in _routes_at(request) for method in getattr(route, "methods", None) or ()}
    return "HEAD" in methods_at(request) and "HEAD" not in own


def _routes_at(request: Request) -> list[BaseRoute]:
    routes: list[BaseRoute] = [route for router in request.app.state.routers for route in router.routes]
    return [route for route in routes if route.matches(request.scope)[0] is not Match.NONE]


def _streams(route: BaseRoute) -> bool:
    answers = getattr(route, "responses", {}).get(200, {})
    return "text/event-stream" in answers.get("content", {})
