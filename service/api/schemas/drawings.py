"""Drawings as they are sent and shown."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from service.api.schemas.base import Input, Number, Output, Text
from service.api.schemas.edits import EditIn
from service.api.schemas.jobs import JobOut
from service.api.schemas.kept import Kept
from service.db.uploads import DrawingRow
from service.domain.drawing_options import MAX_KNOWN_LENGTHS, MAX_WALL_LAYERS, DrawingOptions
from service.domain.drawing_reading import DrawingReading
from service.domain.edits import MAX_EDITS


class KnownLengthIn(Input):
    """Two points of the drawing and their real distance."""

    x1: Number
    y1: Number = Field(description="Pixels, y down; or drawing units, y up.")
    x2: Number
    y2: Number
    length_m: Number = Field(gt=0)


class ScaleIn(Input):
    """The scale, in exactly one way: metres a pixel or unit, a ratio with its dpi, or known lengths."""

    metres_per_unit: Number | None = Field(None, gt=0, description="Metres a pixel or drawing unit.")
    ratio: Number | None = Field(None, gt=0, description="100 for a sheet at 1:100; needs dpi.")
    dpi: Number | None = Field(None, gt=0)
    known_length: KnownLengthIn | None = None
    known_lengths: list[KnownLengthIn] | None = Field(
        None,
        min_length=1,
        max_length=MAX_KNOWN_LENGTHS,
        description="Several: the scale is their least-squares fit.",
    )


class DrawingPatch(BaseModel):
    """What changes of what is said of a drawing; a field left out stays, null takes it back.

    Coordinates are the file's own: pixels with y down, or the units of a vector drawing with y up.
    """

    model_config = ConfigDict(
        extra="allow", allow_inf_nan=False, json_schema_extra={"additionalProperties": False}
    )

    scale: ScaleIn | None = None
    page: int | None = Field(None, ge=1, le=100_000, strict=True)
    storey: Text | None = Field(None, description="Storey of a building model, by its name.")
    cut_height_m: Number | None = Field(None, gt=0, le=100.0)
    wall_layers: list[Text] | None = Field(
        None, max_length=MAX_WALL_LAYERS, description="The layers of a vector file that hold its walls."
    )
    edits: list[EditIn] | None = Field(
        None, max_length=MAX_EDITS, description="The whole list of corrections; it replaces the earlier one."
    )

    def said(self) -> dict[str, Any]:
        """Return the fields that were sent, those that no drawing knows included."""
        return {name: _without_null(value) for name, value in self.model_dump(exclude_unset=True).items()}


def _without_null(value: Any) -> Any:
    """Return a JSON value without the fields of its objects that are null."""
    if isinstance(value, dict):
        return {name: _without_null(one) for name, one in value.items() if one is not None}
    return [_without_null(one) for one in value] if isinstance(value, list) else value


class DrawingFiles(Output):
    """Where the files of the latest finished reading are; null until there is one."""

    preview: str | None
    walls: str | None
    removed: str | None
    sheet: str | None = Field(description="Null of a drawing that is lines, not pixels, as well.")
    tiles: str | None


class DrawingOut(Output):
    """An uploaded drawing, with its latest finished reading and its latest job."""

    id: str
    map_id: str
    file_name: str
    sha256: str
    size_bytes: int
    media_type: str
    options: Kept[DrawingOptions] = Field(description="What was said of it.")
    reading: Kept[DrawingReading | None] = Field(
        description="Scale with its evidence, counts and findings; null until a job has read the drawing."
    )
    files: DrawingFiles
    created_at: datetime
    created_by: str
    job: JobOut

    @classmethod
    def of(cls, row: DrawingRow, *, base_url: str) -> Self:
        """Return the drawing as it is shown."""
        drawing, blob, job = row
        at = f"/v1/drawings/{drawing.id}"
        files = DrawingFiles(
            preview=f"{at}/preview.png" if drawing.preview_sha256 else None,
            walls=f"{at}/walls.geojson" if drawing.walls_sha256 else None,
            removed=f"{at}/removed.geojson" if drawing.removed_sha256 else None,
            sheet=f"{at}/sheet.json" if drawing.sheet_sha256 else None,
            tiles=f"{at}/sheet.bin" if drawing.tiles_sha256 else None,
        )
        return cls(
            id=drawing.id,
            map_id=drawing.map_id,
            file_name=drawing.file_name,
            sha256=blob.sha256,
            size_bytes=blob.size_bytes,
            media_type=blob.media_type,
            options=drawing.options,
            reading=drawing.reading,
            files=files,
            created_at=drawing.created_at,
            created_by=drawing.created_by,
            job=JobOut.of(job, base_url=base_url),
        )


class DrawingAccepted(Output):
    """A drawing that will be read, and the job that reads it."""

    drawing: DrawingOut
    job: JobOut

    @classmethod
    def of(cls, row: DrawingRow, *, base_url: str) -> Self:
        """Return the answer to an upload."""
        shown = DrawingOut.of(row, base_url=base_url)
        return cls(drawing=shown, job=shown.job)
