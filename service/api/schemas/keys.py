"""API keys as they are asked for and shown."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from pydantic import AwareDatetime, Field

from service.api.schemas.base import Identifier, Input, Output, Text
from service.domain.lifecycle import Role


class KeyIn(Input):
    """A new API key."""

    name: Text = Field(description="What people call it, such as the device that holds it.")
    role: Role
    map_ids: Annotated[list[Identifier], Field(min_length=1, max_length=1000)] | None = Field(
        None, description="The maps that it covers; null covers all, also those not yet made."
    )
    expires_at: AwareDatetime | None = None


class KeyOut(Output):
    """An API key; its secret is shown once, when it is made."""

    id: str
    name: str
    role: Role
    map_ids: list[str] | None
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None


class NewKeyOut(KeyOut):
    """A new API key with its secret."""

    key: str = Field(description="The secret, to be sent as `Authorization: Bearer ...`. Kept nowhere else.")
