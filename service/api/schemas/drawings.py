"""Drawings as they are sent and shown."""

from __future__ import annotations

from datetime import datetime
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from service.api.schemas.base import Input, JsonObject, Number, Output
from service.api.schemas.jobs import JobOut
from service.db.uploads import DrawingRow

FORM: JsonObject = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {
                        "file": {
                            "type": "string",
                            "format": "binary",
                            "description": "PNG, JPEG, TIFF or BMP; its own bytes decide, not its name.",
                        },
                        "scale": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "description": 'The scale as JSON: {"metres_per_unit"}, or {"ratio", "dpi"}, or '
                            '{"known_length": {"x1", "y1", "x2", "y2", "length_m"}}.',
                        },
                        "metres_per_unit": {"type": "number", "description": "Or: metres a pixel."},
                        "ratio": {"type": "string", "description": "Or: 100 or 1:100, with dpi."},
                        "dpi": {"type": "number", "description": "Pixels an inch of the sheet."},
                        "known_length": {
                            "type": "string",
                            "description": "Or: x1,y1,x2,y2,L; two points [px, y down] and metres between.",
                        },
                        "page": {"type": "integer", "minimum": 1, "default": 1},
                    },
                },
                "encoding": {"file": {"contentType": "image/png, image/jpeg, image/tiff, image/bmp"}},
            }
        },
    }
}
"""The form of a drawing's upload, for OpenAPI; `service.api.streams` reads it."""


class KnownLengthIn(Input):
    """Two points of the drawing and their real distance."""

    x1: Number
    y1: Number = Field(description="Pixels, y down.")
    x2: Number
    y2: Number
    length_m: Number = Field(gt=0)


class ScaleIn(Input):
    """The scale, in exactly one way: metres a pixel, a ratio with its dpi, or a known length."""

    metres_per_unit: Number | None = Field(None, gt=0, description="Metres a pixel.")
    ratio: Number | None = Field(None, gt=0, description="100 for a sheet at 1:100; needs dpi.")
    dpi: Number | None = Field(None, gt=0)
    known_length: KnownLengthIn | None = None


class DrawingPatch(BaseModel):
    """What changes of what is said of a drawing; a field left out stays."""

    model_config = ConfigDict(
        extra="allow", allow_inf_nan=False, json_schema_extra={"additionalProperties": False}
    )

    scale: ScaleIn | None = None
    page: int | None = Field(None, ge=1, le=100_000, strict=True)

    def said(self) -> dict[str, Any]:
        """Return the fields that were sent, those that no drawing knows included."""
        return self.model_dump(exclude_unset=True, exclude_none=True)


class DrawingFiles(Output):
    """Where the files of the latest finished reading are; null until there is one."""

    preview: str | None
    walls: str | None
    removed: str | None


class DrawingOut(Output):
    """An uploaded drawing, with its latest finished reading and its latest job."""

    id: str
    map_id: str
    file_name: str
    sha256: str
    size_bytes: int
    media_type: str
    options: JsonObject = Field(description="What was said of it: `scale` (if it was) and `page`.")
    reading: JsonObject | None = Field(
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
