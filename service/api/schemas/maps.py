"""Maps as they are asked for and shown."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from service.api.schemas.base import Input, Output, Text


class MapIn(Input):
    """A new map."""

    site: Text = Field(description="The factory; maps of one site share its common origin.")
    name: Text = Field(description="The floor; unique in its site.")


class MapPatch(Input):
    """What changes of a map; a field left out stays."""

    site: Text | None = None
    name: Text | None = None


class MapOut(Output):
    """One floor of one site: the identity that lasts."""

    id: str
    site: str
    name: str
    created_at: datetime
    updated_at: datetime
