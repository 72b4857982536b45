"""Corrections of a drawing's reading as they are sent."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from service.api.schemas.base import Input, Number
from service.domain.edits import LAYERS, MAX_STROKES, MAX_THICKNESS_M, MAX_VERTICES

PointIn = Annotated[list[Number], Field(min_length=2, max_length=2)]
PolygonIn = Annotated[list[PointIn], Field(min_length=3, max_length=MAX_VERTICES)]
LayerIn = Annotated[str, Field(json_schema_extra={"enum": list(LAYERS)})]


class MoveIn(Input):
    """Strokes belong to another layer: moved to `wall` they become walls, from it they are set aside."""

    action: Literal["move"]
    to: LayerIn
    strokes: list[str] | None = Field(
        None,
        min_length=1,
        max_length=MAX_STROKES,
        description="Their ids, from `walls.geojson` and `removed.geojson`; or say `within`.",
    )
    within: PolygonIn | None = Field(None, description="Or: all that lies in the polygon by more than half.")
    of: list[LayerIn] | None = Field(
        None, max_length=len(LAYERS), description="With `within`: only what is in these layers."
    )


class DrawingRegionIn(Input):
    """A polygon. `include`: nothing counts outside of it, or of another such; `exclude`: nothing inside.

    `erase-walls`: walls are cut away in it.
    """

    action: Literal["include", "exclude", "erase-walls"]
    within: PolygonIn


class AddWallIn(Input):
    """A wall that the drawing does not show."""

    action: Literal["add-wall"]
    line: list[PointIn] = Field(
        min_length=2, max_length=MAX_VERTICES, description="Centre line, in the file's own coordinates."
    )
    thickness_m: Number | None = Field(
        None, gt=0, le=MAX_THICKNESS_M, description="As the drawing's other walls where it is left out."
    )


EditIn = Annotated[MoveIn | DrawingRegionIn | AddWallIn, Field(discriminator="action")]
