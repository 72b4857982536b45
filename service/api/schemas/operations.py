"""What can be done to a map, as requests name it: one object an operation, told apart by `op`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from service.api.schemas.base import Identifier, Input, Number, Text
from service.domain.errors import InvalidRequest
from service.domain.layer_part import LayerPart
from service.domain.map_state import pose_of
from service.domain.operations import (
    CutLayer,
    MoveLayer,
    RemoveLayer,
    RenameLayer,
    RestoreRegion,
    SetRecipe,
    ShiftLayer,
    ShowLayer,
)
from service.domain.region import MAX_REGIONS, MAX_VERTICES, Region
from service.domain.transform import Transform
from service.usecases.plan_operations import (
    WantedDrawing,
    WantedErasure,
    WantedLayer,
    WantedOperation,
    WantedReplacement,
)

_Row = Annotated[list[Number], Field(min_length=4, max_length=4)]


class RegionIn(Input):
    """A polygon seen from above, in frame `map`, between two heights if they are given."""

    within: list[Annotated[list[Number], Field(min_length=2, max_length=2)]] = Field(
        min_length=3, max_length=MAX_VERTICES, description="Corners [x, y], in metres."
    )
    z_min_m: Number | None = None
    z_max_m: Number | None = None


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

    def wanted(self) -> WantedLayer:
        """Return the layer as the use cases take it."""
        return WantedLayer(self.placement_id, self.name, self.reviewed, self.part.part())


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


class AddLayerIn(LayerIn):
    """Put a placed scan on top of the others."""

    op: Literal["add-layer"]


class ShiftIn(Input):
    """How far a layer is moved: along the axes of the map, and turned about its scan's origin."""

    x_m: Number = 0.0
    y_m: Number = 0.0
    z_m: Number = 0.0
    yaw_rad: Number = 0.0


class MoveLayerIn(Input):
    """Move a layer: to a pose, or by a shift; one of the two."""

    op: Literal["move-layer"]
    layer_id: Identifier
    T_map_scan: Annotated[list[_Row], Field(min_length=4, max_length=4)] | None = Field(
        None, description="Where the scan is to lie: a rigid 4x4 matrix, row by row, in metres."
    )
    by: ShiftIn | None = None

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        if (self.T_map_scan is None) == (self.by is None):
            raise _invalid("by", "A layer is moved to a T_map_scan, or by a shift: give one of the two.")
        if self.by is not None:
            return ShiftLayer(self.layer_id, self.by.x_m, self.by.y_m, self.by.z_m, self.by.yaw_rad)
        pose = pose_of(self.T_map_scan)
        try:
            Transform.of(pose)
        except ValueError as error:
            raise _invalid("T_map_scan", f"This is no rigid motion: {error}.") from error
        return MoveLayer(self.layer_id, pose)


class ReplaceLayerIn(Input):
    """Put another placed scan in a layer's stead."""

    op: Literal["replace-layer"]
    layer_id: Identifier
    placement_id: Identifier
    name: Text | None = None
    reviewed: bool = Field(
        False, description="A person has looked at a placement that needs a review.", strict=True
    )
    part: LayerPartIn = LayerPartIn()

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return WantedReplacement(self.layer_id, self.placement_id, self.name, self.reviewed, self.part.part())


class ShowLayerIn(Input):
    """Hide a layer, or show it again: a hidden one stays in the revision and out of its files."""

    op: Literal["hide-layer", "show-layer"]
    layer_id: Identifier

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return ShowLayer(self.layer_id, visible=self.op == "show-layer")


class RenameLayerIn(Input):
    """Call a layer something else."""

    op: Literal["rename-layer"]
    layer_id: Identifier
    name: Text

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return RenameLayer(self.layer_id, self.name)


class CutLayerIn(Input):
    """Choose anew which of its scan's points a layer holds."""

    op: Literal["cut-layer"]
    layer_id: Identifier
    part: LayerPartIn

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return CutLayer(self.layer_id, self.part.part().to_json())


class RemoveLayerIn(Input):
    """Take a layer off; earlier revisions keep it."""

    op: Literal["remove-layer"]
    layer_id: Identifier

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return RemoveLayer(self.layer_id)


class EraseRegionIn(Input):
    """Take off what stands in a region now; what is added later is not erased by it."""

    op: Literal["erase-region"]
    region: RegionIn
    drawing: bool = Field(True, description="Whether walls, floor and ceiling are erased.", strict=True)
    layer_ids: Annotated[list[Identifier], Field(max_length=1000)] | None = Field(
        None, description="Only from these layers; left out, from all."
    )

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        region = Region.from_json(self.region.model_dump(exclude_none=True), "#/operations/region")
        return WantedErasure(region, self.drawing, self.layer_ids)


class RestoreRegionIn(Input):
    """Bring back what an erased region took off."""

    op: Literal["restore-region"]
    region_id: Identifier

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return RestoreRegion(self.region_id)


class SetRecipeIn(Input):
    """Change fields of the recipe; the others stay."""

    op: Literal["set-recipe"]
    recipe: RecipeIn

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return SetRecipe(self.recipe.model_dump(exclude_unset=True))


class SetDrawingIn(Input):
    """Put another drawing under the layers, or the same as it is read now."""

    op: Literal["set-drawing"]
    drawing_id: Identifier

    def wanted(self) -> WantedOperation:
        """Return the operation as the use cases take it."""
        return WantedDrawing(self.drawing_id)


OperationIn = Annotated[
    AddLayerIn
    | MoveLayerIn
    | ReplaceLayerIn
    | ShowLayerIn
    | RenameLayerIn
    | CutLayerIn
    | RemoveLayerIn
    | EraseRegionIn
    | RestoreRegionIn
    | SetRecipeIn
    | SetDrawingIn,
    Field(discriminator="op"),
]
"""One operation; `op` tells which."""


def _invalid(name: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": f"#/operations/{name}", "detail": detail}])
