"""Proposals to take off what a later scan looked through, as they are shown."""

from __future__ import annotations

from datetime import datetime

from pydantic import Field

from service.api.schemas.base import Output
from service.api.schemas.kept import Kept
from service.domain.gone import GoneLayer
from service.domain.lifecycle import ProposalState


class ProposalOut(Output):
    """Things of a layer that a placed scan looked through: they seem to have gone."""

    id: str
    map_id: str
    placement_id: str = Field(description="The placement of the scan that looked through it.")
    layer_id: str
    state: ProposalState
    evidence: Kept[GoneLayer] = Field(description="What has gone, thing by thing.")
    revision_n: int | None = Field(description="The revision that took it off, once accepted.")
    created_at: datetime
    decided_at: datetime | None
    decided_by: str | None
