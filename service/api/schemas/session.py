"""A browser's session: the key that it was given."""

from __future__ import annotations

from pydantic import Field

from service.api.schemas.base import Input, Output, Text
from service.domain.lifecycle import Role


class SessionIn(Input):
    """The key to sign in with."""

    key: Text = Field(description="The secret of an API key, `gp_...`.")


class SessionOut(Output):
    """Who is signed in: a key, its role and its maps (null: all of them)."""

    key_id: str
    role: Role
    map_ids: list[str] | None
