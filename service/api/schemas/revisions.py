"""Revisions, their recipes, layers and files, as they are asked for and shown."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal, Self

from pydantic import Field

from service.api.schemas.base import Identifier, Input, JsonObject, Number, Output, Text
from service.api.schemas.jobs import JobOut
from service.db.models import Artifact
from service.domain.layer_part import LayerPart
from service.domain.lifecycle import RevisionStatus
from service.domain.region import MAX_REGIONS, MAX_VERTICES
from service.usecases.publish import Published
from service.usecases.revise import Revised, Wanted, WantedLayer
from service.usecases.revisions import Shown


class RegionIn(Input):
    """A polygon seen from above, in frame `map`, between two heights if they are given."""

    within: list[Annotated[list[Number], Field(min_length=2, max_length=2)]] = Field(
        min_length=3, max_length=MAX_VERTICES, description="Corners [x, y], in metres."
    )
    z_min_m: Number | None = None
    z_max_m: Number | None = None


class MapFromDrawingIn(Input):
    """`T_map_drawing`: where the drawing's origin lies in the map, and how it is turned."""

    x_m: Number = 0.0
    y_m: Number = 0.0
    yaw_rad: Number = 0.0


class RecipeIn(Input):
    """How the map is built; a field left out comes from the base, or is the default."""

    voxel_size_m: Number = Field(0.4, ge=0.005, le=5, description="Edge of the voxel grid filter.")
    wall_height_m: Number = Field(2.5, ge=0.1, le=100, description="Height to which walls are stacked.")
    floor: bool = Field(False, description="Whether there is a floor at z = 0.", strict=True)
    ceiling: bool = Field(False, description="Whether there is a ceiling at the wall height.", strict=True)
    layer_voxel_size_m: Number = Field(0.05, ge=0.005, le=5, description="Voxel edge of placed scans.")
    occupancy_resolution_m: Number = Field(0.05, ge=0.01, le=1, description="Cell of the occupancy grid.")
    map_from_drawing: MapFromDrawingIn = MapFromDrawingIn()


class LayerPartIn(Input):
    """Which of a placed scan's points a layer holds."""

    points: Literal["target", "all"] = Field(
        "target", description="What the map did not explain when the scan was placed, or every point."
    )
    include: list[RegionIn] = Field(
        default_factory=list, max_length=MAX_REGIONS, description="Where all points are taken too."
    )
    exclude: list[RegionIn] = Field(
        default_factory=list, max_length=MAX_REGIONS, description="Where no point is taken; comes last."
    )

    def part(self) -> LayerPart:
        """Return the part as the use cases take it."""
        return LayerPart.from_json(self.model_dump(exclude_none=True))


class LayerIn(Input):
    """A placed scan that the revision is to contain."""

    placement_id: Identifier
    name: Text = "layer"
    reviewed: bool = Field(
        False, description="A person has looked at a placement that needs a review.", strict=True
    )
    part: LayerPartIn = LayerPartIn()


class RevisionIn(Input):
    """A new revision. With `base`, what is left out is taken over from it; without, nothing is."""

    base: Annotated[int, Field(ge=1, le=2**31 - 1, strict=True)] | None = Field(
        None, description="The map's latest revision, if it is to be changed; an earlier one is refused."
    )
    drawing_id: Identifier | None = Field(None, description="A read drawing; needed without `base`.")
    recipe: RecipeIn = RecipeIn()
    layers: Annotated[list[LayerIn], Field(max_length=1000)] | None = Field(
        None, description="All layers in their order; an empty list drops those of the base."
    )

    def wanted(self) -> Wanted:
        """Return the body as the use case takes it."""
        layers = (
            None
            if self.layers is None
            else [WantedLayer(x.placement_id, x.name, x.reviewed, x.part.part()) for x in self.layers]
        )
        recipe = self.recipe.model_dump(exclude_unset=True)
        return Wanted(base=self.base, drawing_id=self.drawing_id, recipe=recipe, layers=layers)


class LayerOut(Output):
    """A placed scan in a revision."""

    name: str
    scan_id: str
    placement_id: str
    part: JsonObject | None = Field(
        description="Which of the scan's points it holds; null, all of them, in layers of the first days."
    )


class RevisionOut(Output):
    """An immutable numbered state of a map; `ready` and `failed` are final."""

    map_id: str
    n: int
    parent_n: int | None
    status: RevisionStatus
    recipe: JsonObject
    drawing_id: str
    layers: list[LayerOut]
    job_id: str
    report: JsonObject | None = Field(description="What was built from what, once it is ready.")
    created_at: datetime
    ended_at: datetime | None

    @classmethod
    def of(cls, shown: Shown) -> Self:
        """Return a revision as JSON."""
        layers = [LayerOut.model_validate(layer) for layer in shown.layers]
        fields = {name: getattr(shown.revision, name) for name in cls.model_fields if name != "layers"}
        return cls(**fields, layers=layers)


class RevisionWithJob(Output):
    """A new revision, building, and the job that builds it."""

    revision: RevisionOut
    job: JobOut

    @classmethod
    def of(cls, revised: Revised, *, base_url: str) -> Self:
        """Return a new revision as JSON."""
        return cls(revision=RevisionOut.of(revised.shown), job=JobOut.of(revised.job, base_url=base_url))


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


class PublishIn(Input):
    """Where a revision is to be published."""

    channel: Channel = "stable"


class PublishedOut(Output):
    """What a robot should run: the channel's revision and its files."""

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
            revision=pointer.revision_n,
            published_at=pointer.published_at,
            artifacts=[
                ArtifactOut.of(row, map_id=pointer.map_id, n=pointer.revision_n, base_url=base_url)
                for row in found.artifacts
            ],
        )
