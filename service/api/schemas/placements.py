"""Placements as they are asked for and shown."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal, Self

from pydantic import Field

from service.api.schemas.base import Input, Number, Output, Text
from service.api.schemas.jobs import JobOut
from service.api.schemas.kept import Kept
from service.api.schemas.operations import LayerPartIn
from service.db.models import Placement
from service.domain.evidence import Candidate, PlacementEvidence
from service.domain.reasons import Reason
from service.domain.rough_pose import RoughPose
from service.usecases.place import Asked, WantedPlacement

Coordinate = Annotated[Number, Field(ge=-1e6, le=1e6)]


class RoughPoseIn(Input):
    """A rough `T_map_scan`: where the scan's origin lies in the map, and how it is turned about z."""

    x_m: Coordinate
    y_m: Coordinate
    z_m: Coordinate = 0.0
    yaw_rad: Coordinate = 0.0


class PlacementIn(Input):
    """How a scan is to be placed."""

    rough_pose: RoughPoseIn | None = Field(
        None,
        description="Where to look, give or take 3 m and 45 degrees; by default the rough pose that came "
        "with the scan, and where there is none, everywhere.",
    )
    search: bool = Field(
        False,
        description="Look everywhere on the map, also where the scan came with a rough pose.",
        strict=True,
    )
    revision: Annotated[int, Field(ge=1, le=2**31 - 1, strict=True)] | None = Field(
        None, description="The revision to place it on; by default the latest ready one."
    )
    ndt_resolution_m: Number = Field(1.0, ge=0.1, le=10, description="Edge of a cell of the NDT map.")

    def wanted(self) -> WantedPlacement:
        """Return the body as the use case takes it."""
        pose = None if self.rough_pose is None else RoughPose(**self.rough_pose.model_dump())
        return WantedPlacement(pose, self.search, self.revision, self.ndt_resolution_m)


class AcceptIn(Input):
    """How a placement is taken into the map."""

    reviewed: bool = Field(
        False, description="A person has looked at a placement that needs a review.", strict=True
    )
    name: Text | None = Field(None, description="Name of the layer; by default the scan's file name.")
    part: LayerPartIn = Field(
        default_factory=LayerPartIn, description="Which points are taken; by default the target alone."
    )


class PlacementOut(Output):
    """One attempt to place a scan on a revision; null members come with its job's success."""

    id: str
    map_id: str
    scan_id: str
    revision: int = Field(validation_alias="revision_n", description="The revision it was placed on.")
    initial_pose: Kept[RoughPose | None] = Field(
        description="The rough pose it started from; null where it was searched for everywhere."
    )
    ndt_resolution_m: float
    T_map_scan: list[list[float]] | None = Field(
        description="4x4, row by row: takes coordinates of the scan to coordinates of the map [m]."
    )
    verdict: Literal["accepted", "needs-review", "rejected"] | None
    reasons: Kept[list[Reason] | None] = Field(description="Why the verdict is what it is.")
    evidence: Kept[PlacementEvidence | None] = Field(description="The measurements behind the verdict.")
    candidates: Kept[list[Candidate] | None] = Field(
        description="Poses that were considered, the one given first."
    )
    job_id: str
    created_at: datetime

    @classmethod
    def of(cls, row: Placement) -> Self:
        """Return a placement as JSON."""
        return cls.model_validate(row)


class PlacementWithJob(Output):
    """A new placement and the job that computes it."""

    placement: PlacementOut
    job: JobOut

    @classmethod
    def of(cls, asked: Asked, *, base_url: str) -> Self:
        """Return a new placement as JSON."""
        return cls(placement=PlacementOut.of(asked.placement), job=JobOut.of(asked.job, base_url=base_url))
