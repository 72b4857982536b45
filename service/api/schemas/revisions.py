"""Revisions, their recipes, layers and files, as they are asked for and shown."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Self

from pydantic import Field

from service.api.schemas.base import Identifier, Input, JsonObject, Output, Remark
from service.api.schemas.jobs import JobOut
from service.api.schemas.kept import Kept
from service.api.schemas.operations import LayerIn, OperationIn, RecipeIn
from service.db.models import Artifact
from service.domain.errors import InvalidRequest
from service.domain.history import DoneOperation
from service.domain.layer_part import LayerPart
from service.domain.lifecycle import RevisionStatus
from service.domain.map_state import ErasedRegion
from service.domain.recipe import Recipe
from service.domain.report import BuildReport
from service.usecases.publish import Published, Said
from service.usecases.revise import Revised, Wanted
from service.usecases.revisions import Shown


class RevisionIn(Input):
    """A new revision. With `base`, what is left out is taken over from it; without, nothing is.

    What others did since `base` is kept where it is about other things; else the request is refused.
    """

    base: Annotated[int, Field(ge=1, le=2**31 - 1, strict=True)] | None = Field(
        None, description="The revision that is changed: the one that the person who asks has in view."
    )
    drawing_id: Identifier | None = Field(None, description="A read drawing; needed without `base`.")
    recipe: RecipeIn = RecipeIn()
    layers: Annotated[list[LayerIn], Field(max_length=1000)] | None = Field(
        None, description="All layers in their order; an empty list drops those of the base."
    )
    operations: Annotated[list[OperationIn], Field(max_length=200)] = Field(
        default_factory=list, description="What is done to the base, one after the other; needs `base`."
    )
    reason: Remark | None = Field(None, description="Why, for the history.")

    def wanted(self) -> Wanted:
        """Return the body as the use case takes it."""
        if self.operations and self.base is None:
            detail = "Operations change a revision: name it as `base`."
            raise InvalidRequest(detail, errors=[{"pointer": "#/base", "detail": detail}])
        return Wanted(
            base=self.base,
            drawing_id=self.drawing_id,
            recipe=self.recipe.model_dump(exclude_unset=True),
            layers=None if self.layers is None else [layer.wanted() for layer in self.layers],
            operations=[operation.wanted() for operation in self.operations],
            reason=self.reason,
        )


class LayerOut(Output):
    """A placed scan in a revision; `layer_id` names it from revision to revision."""

    layer_id: str
    name: str
    scan_id: str
    placement_id: str
    part: Kept[LayerPart | None] = Field(
        description="Which of the scan's points it holds; null, all of them, in layers of the first days."
    )
    visible: bool = Field(description="Whether its points are in the revision's files.")
    T_map_scan: list[list[float]] | None = Field(
        description="Where the scan lies; null, where its placement has it, in layers of the first days."
    )
    accepted_by: str | None = Field(description="The key that took the placement into the map.")
    accepted_at: datetime | None


class RevisionOut(Output):
    """An immutable numbered state of a map; `ready` and `failed` are final."""

    map_id: str
    n: int
    parent_n: int | None = Field(description="The revision that the operations were applied to.")
    base_n: int | None = Field(description="The revision that the person who asked had in view.")
    status: RevisionStatus
    recipe: Kept[Recipe]
    drawing_id: str
    layers: list[LayerOut]
    erased: Kept[list[ErasedRegion] | None] = Field(description="Regions whose points were taken off.")
    operations: Kept[list[DoneOperation] | None] = Field(description="What was done to the parent.")
    reason: str | None
    job_id: str
    report: Kept[BuildReport | None] = Field(description="What was built from what, once it is ready.")
    software_version: str | None = Field(description="The version of this software that built it.")
    artifacts_sha256: str | None = Field(
        description="SHA-256 over the sorted lines `<sha256>  <path>` of all its files."
    )
    pruned_at: datetime | None = Field(description="When its files were let go to make room.")
    created_at: datetime
    created_by: str
    ended_at: datetime | None

    @classmethod
    def of(cls, shown: Shown) -> Self:
        """Return a revision as JSON."""
        layers = [LayerOut.model_validate(layer) for layer in shown.layers]
        fields = {name: getattr(shown.revision, name) for name in cls.model_fields if name != "layers"}
        return cls(**fields, layers=layers)


class DifferenceOut(Output):
    """One thing in which two states of a map differ."""

    subject: str = Field(
        description="`drawing`, `recipe.<field>`, `layer.<id>`, `scan.<id>`, `order` or `region.<id>`."
    )
    change: str
    message: str
    before: JsonObject | None
    after: JsonObject | None


class RebasedOut(Output):
    """That a change was put onto a later revision than the one it was made for, and what lies between."""

    base: int
    onto: int
    changes: list[DifferenceOut]


class RevisionWithJob(Output):
    """A new revision, building, and the job that builds it."""

    revision: RevisionOut
    job: JobOut
    rebased: RebasedOut | None = Field(
        description="What others changed since the base, kept in this revision; null if nobody did."
    )

    @classmethod
    def of(cls, revised: Revised, *, base_url: str) -> Self:
        """Return a new revision as JSON."""
        rebased = None if revised.rebased is None else RebasedOut.model_validate(revised.rebased)
        job = JobOut.of(revised.job, base_url=base_url)
        return cls(revision=RevisionOut.of(revised.shown), job=job, rebased=rebased)


class ArtifactOut(Output):
    """A file of a ready revision."""

    path: str
    sha256: str = Field(description="SHA-256 of its bytes (hex); also its ETag.")
    size_bytes: int
    media_type: str
    url: str

    @classmethod
    def of(cls, row: Artifact, *, map_id: str, n: int, base_url: str) -> Self:
        """Return a file as JSON."""
        return cls(
            path=row.path,
            sha256=row.sha256,
            size_bytes=row.size_bytes,
            media_type=row.media_type,
            url=f"{base_url}/v1/maps/{map_id}/revisions/{n}/artifacts/{row.path}",
        )


Channel = Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,39}$")]
"""A channel's name: small letters, digits and hyphens."""


class OverrideIn(Input):
    """An admin's word for publishing although something stands against it; kept under the key's name."""

    reason: Remark


class PublishIn(Input):
    """Where a revision is to be published, and why."""

    channel: Channel = "stable"
    reason: Remark | None = Field(None, description="Why, for the history.")
    override: OverrideIn | None = Field(None, description="Publish although gates are closed.")

    def said(self) -> Said:
        """Return the remarks as the use case takes them."""
        return Said(self.reason, None if self.override is None else self.override.reason)


class PublishedOut(Output):
    """What a robot should run: the channel's revision, or that of a roll-out, and its files."""

    map_id: str
    channel: str
    revision: int
    published_at: datetime
    artifacts: list[ArtifactOut]

    @classmethod
    def of(cls, found: Published, *, base_url: str) -> Self:
        """Return a channel as JSON."""
        pointer = found.pointer
        return cls(
            map_id=pointer.map_id,
            channel=pointer.name,
            revision=found.n,
            published_at=pointer.published_at,
            artifacts=[
                ArtifactOut.of(row, map_id=pointer.map_id, n=found.n, base_url=base_url)
                for row in found.artifacts
            ],
        )
