"""Tablet scans as they are sent and shown."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Self

from pydantic import Field

from service.api.schemas.base import JsonObject, Output
from service.api.schemas.jobs import JobOut
from service.api.schemas.kept import Kept
from service.db.uploads import ScanRow
from service.domain.errors import InvalidRequest
from service.domain.formats import Purpose, listed
from service.domain.rough_pose import RoughPose
from service.domain.scan_options import UNITS, UP_AXES, SaidOfScan, ScanOptions
from service.domain.scan_reading import ScanReading

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
                            "description": f"{listed(Purpose.SCAN)}; its own bytes decide, not its name. "
                            "Unit and up axis are found.",
                        },
                        "up": {
                            "type": "string",
                            "enum": list(UP_AXES),
                            "description": "Which of the file's axes is up, where that is known better.",
                        },
                        "unit": {
                            "type": "string",
                            "enum": list(UNITS),
                            "description": "What the file's numbers count, where that is known better.",
                        },
                        "rough_pose": {
                            "type": "string",
                            "contentMediaType": "application/json",
                            "description": "Roughly where the scan was taken, `T_map_scan` as JSON: "
                            '{"x_m", "y_m", "z_m", "yaw_rad"}; z_m and yaw_rad default to 0.',
                        },
                    },
                },
                "encoding": {"file": {"contentType": "application/octet-stream"}},
            }
        },
    }
}
"""The form of a scan's upload, for OpenAPI; `service.api.bodies` reads it."""


def said_of(fields: Mapping[str, str]) -> SaidOfScan:
    """Return what the fields of a form say of a scan.

    Raises
    ------
    InvalidRequest
        If one is wrong, or there are other fields.
    """
    said: dict[str, Any] = {name: text.strip() for name, text in fields.items()}
    if pose := said.pop("rough_pose", ""):
        try:
            said["rough_pose"] = json.loads(pose)
        except (ValueError, RecursionError) as error:
            raise _invalid("#/rough_pose", f"The field is no JSON: {error}.") from None
    return SaidOfScan.from_json(said)


class ScanFiles(Output):
    """Where the files of the finished reading are; null until there is one."""

    preview: str | None
    points: str | None


class ScanOut(Output):
    """An uploaded tablet scan, with its reading and its latest job."""

    id: str
    map_id: str
    file_name: str
    sha256: str
    size_bytes: int
    media_type: str
    rough_pose: Kept[RoughPose | None] = Field(
        description="Where its sender thinks it was taken: `T_map_scan`."
    )
    options: Kept[ScanOptions | None] = Field(
        description="What was said of the file: `up` and `metres_per_unit`, null where they are found."
    )
    reading: Kept[ScanReading | None] = Field(
        description="Counts, extent and findings; null until a job has read the scan."
    )
    files: ScanFiles
    created_at: datetime
    created_by: str
    job: JobOut

    @classmethod
    def of(cls, row: ScanRow, *, base_url: str) -> Self:
        """Return the scan as it is shown."""
        scan, blob, job = row
        at = f"/v1/scans/{scan.id}"
        files = ScanFiles(
            preview=f"{at}/preview.png" if scan.preview_sha256 else None,
            points=f"{at}/points" if scan.points_sha256 else None,
        )
        return cls(
            id=scan.id,
            map_id=scan.map_id,
            file_name=scan.file_name,
            sha256=blob.sha256,
            size_bytes=blob.size_bytes,
            media_type=blob.media_type,
            rough_pose=scan.rough_pose,
            options=scan.options,
            reading=scan.reading,
            files=files,
            created_at=scan.created_at,
            created_by=scan.created_by,
            job=JobOut.of(job, base_url=base_url),
        )


class ScanAccepted(Output):
    """A scan that will be read, and the job that reads it."""

    scan: ScanOut
    job: JobOut

    @classmethod
    def of(cls, row: ScanRow, *, base_url: str) -> Self:
        """Return the answer to an upload."""
        shown = ScanOut.of(row, base_url=base_url)
        return cls(scan=shown, job=shown.job)


def _invalid(pointer: str, detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": pointer, "detail": detail}])
