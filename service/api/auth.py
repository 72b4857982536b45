"""Keys, sent as bearer or in a browser's session cookie: who asks, checked on every request.

A browser sends its cookies for the requests of foreign pages, too. SameSite=Strict stops that in browsers
of today; and no change is made for a cookie without the header `X-Groundplan-Session`, which a form cannot
send at all and a foreign script only after asking this service, which never agrees.
"""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Request
from fastapi.security import APIKeyCookie, HTTPAuthorizationCredentials, HTTPBearer
from starlette.types import Scope

from service.api.deps import KernelDep
from service.domain.access import Actor
from service.domain.errors import OriginNotProven
from service.domain.lifecycle import Role
from service.usecases.keys import authenticate

_bearer = HTTPBearer(
    auto_error=False,
    scheme_name="key",
    description="An API key `gp_...` of the role tablet, robot or admin, limited to some maps or not.",
)

SESSION_COOKIE = "groundplan_session"
SESSION_HEADER = "X-Groundplan-Session"
_HARMLESS = {"GET", "HEAD", "OPTIONS"}

_cookie = APIKeyCookie(
    name=SESSION_COOKIE,
    auto_error=False,
    scheme_name="session",
    description=f"The key of a browser that signed in; changes need the header `{SESSION_HEADER}`, too.",
)


async def presented_secret(scope: Scope) -> str | None:
    """Return the key that a request presents, read as the routes read it, or None."""
    request = Request(scope)
    bearer = await _bearer(request)
    return await _cookie(request) if bearer is None else bearer.credentials


def require_own_page(request: Request) -> None:
    """Pass when the request was not sent by a foreign page.

    Raises
    ------
    OriginNotProven
        If it would change something and lacks the header that only our own page can send.
    """
    if request.method not in _HARMLESS and SESSION_HEADER not in request.headers:
        raise OriginNotProven(f"A session's {request.method} needs the header `{SESSION_HEADER}: 1`.")


def _presented(
    request: Request,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
    cookie: Annotated[str | None, Depends(_cookie)],
) -> HTTPAuthorizationCredentials | None:
    if bearer is not None or cookie is None:
        return bearer
    require_own_page(request)
    return HTTPAuthorizationCredentials(scheme="Bearer", credentials=cookie)


Presented = Annotated[HTTPAuthorizationCredentials | None, Depends(_presented)]
"""The key as it was sent."""


def _actor(kernel: KernelDep, presented: Presented) -> Actor:
    secret = presented.credentials if presented is not None else None
    with kernel.db.reading() as session:
        return authenticate(session, secret, now=kernel.now())


def _tablet(actor: Annotated[Actor, Depends(_actor)]) -> Actor:
    actor.require_role(Role.TABLET, Role.ADMIN)
    return actor


def _admin(actor: Annotated[Actor, Depends(_actor)]) -> Actor:
    actor.require_role(Role.ADMIN)
    return actor


AnyActor = Annotated[Actor, Depends(_actor)]
"""Whoever holds a valid key: robot, tablet or admin."""

TabletActor = Annotated[Actor, Depends(_tablet)]
"""A tablet or an admin."""

AdminActor = Annotated[Actor, Depends(_admin)]
"""An admin."""
