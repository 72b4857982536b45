"""Bearer keys: who asks, checked on every request against the database."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from service.api.deps import KernelDep
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.keys import authenticate

_bearer = HTTPBearer(
    auto_error=False,
    scheme_name="key",
    description="An API key `gp_...` of the role tablet, robot or admin, limited to some maps or not.",
)

Presented = Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)]
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
