"""What became of revisions: how two differ, what stands against publishing one, and who published which."""

from __future__ import annotations

from datetime import datetime
from typing import Self

from pydantic import Field

from service.api.schemas.base import Output
from service.api.schemas.jobs import JobOut
from service.api.schemas.kept import Kept
from service.api.schemas.revisions import DifferenceOut
from service.db.models import Publication
from service.domain.comparison import CloudComparison
from service.domain.reasons import Reason
from service.usecases.compare import Compared


class ComparedOut(Output):
    """In what two revisions differ: what they are made of, and their points."""

    from_revision: int
    to_revision: int
    differences: list[DifferenceOut]
    geometry: Kept[CloudComparison | None] = Field(
        description="Points and tiles added and removed; null until the job has ended well."
    )
    picture_url: str | None = Field(description="What went and what came, from above.")
    job: JobOut

    @classmethod
    def of(cls, found: Compared, *, map_id: str, base_url: str) -> Self:
        """Return a comparison as JSON."""
        where = f"{base_url}/v1/maps/{map_id}/revisions/{found.to_n}/compare.png?with={found.from_n}"
        return cls(
            from_revision=found.from_n,
            to_revision=found.to_n,
            differences=[DifferenceOut.model_validate(one) for one in found.differences],
            geometry=found.geometry,
            picture_url=None if found.geometry is None else where,
            job=JobOut.of(found.job, base_url=base_url),
        )


class GateOut(Output):
    """One thing that stands against publishing a revision."""

    code: str
    subject: str
    message: str
    reasons: Kept[list[Reason]] = Field(
        default_factory=list, description="Of the verdict of a placement that was not accepted."
    )


class GatesOut(Output):
    """What stands against publishing a revision on a channel; an empty list: nothing."""

    revision: int
    channel: str
    gates: list[GateOut]


class ChannelOut(Output):
    """Where a channel points, and since when."""

    name: str
    revision_n: int
    generation: int = Field(description="How often the pointer was moved.")
    published_at: datetime


class ChannelsOut(Output):
    """All channels of a map, by name."""

    channels: list[ChannelOut]


class PublicationOut(Output):
    """One move of a channel's pointer."""

    id: str
    channel: str
    generation: int
    from_n: int | None
    to_n: int
    rolled_back: bool = Field(description="Whether it went to an earlier revision.")
    published_at: datetime
    published_by: str = Field(description="Id of the key.")
    reason: str | None
    overridden: list[GateOut] | None = Field(description="The gates that an admin overrode.")

    @classmethod
    def of(cls, row: Publication) -> Self:
        """Return a move as JSON."""
        fields = {name: getattr(row, name) for name in cls.model_fields if name != "rolled_back"}
        return cls(**fields, rolled_back=row.from_n is not None and row.to_n < row.from_n)
