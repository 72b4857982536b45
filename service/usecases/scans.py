"""Find and list the tablet scans of a map."""

from __future__ import annotations

from collections.abc import Sequence

from service.db import uploads as table
from service.db.session import Session
from service.db.uploads import ScanRow
from service.domain.access import Actor
from service.domain.errors import ArtifactNotFound, ScanNotFound
from service.usecases.download import StoredFile, stored_file
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map

_FILES = {
    "preview.png": ("preview_sha256", "image/png", "preview.png"),
    "points": ("points_sha256", "application/octet-stream", "points.pcd"),
}


def covered_scan(session: Session, actor: Actor, *, scan_id: str) -> ScanRow:
    """Return a scan that exists and whose map the key covers, with its file and its latest job.

    Raises
    ------
    ScanNotFound
        If there is none: missing and not covered cannot be told apart.
    """
    missing = ScanNotFound(f"There is no scan {scan_id}, or this key does not cover its map.")
    row = table.find_scan_row(session, scan_id)
    if row is None:
        raise missing
    actor.require_map(row[0].map_id, otherwise=missing)
    return row


def list_scans(
    session: Session, actor: Actor, *, map_id: str, after: str | None, limit: int
) -> Sequence[ScanRow]:
    """Return up to `limit` scans of the map, in the order of their making.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    covered_map(session, actor, map_id=map_id)
    return table.list_scan_rows(session, map_id, after=after, limit=limit)


def scan_file(kernel: Kernel, session: Session, actor: Actor, *, scan_id: str, name: str) -> StoredFile:
    """Return a file of the scan's finished reading.

    Raises
    ------
    ScanNotFound
        If there is no such scan for the key.
    ArtifactNotFound
        If a reading has no such file, or the scan no finished reading yet.
    """
    scan, _, job = covered_scan(session, actor, scan_id=scan_id)
    if name not in _FILES:
        raise ArtifactNotFound(f"A scan has no file {name!r}; it has {', '.join(sorted(_FILES))}.")
    column, media_type, file_name = _FILES[name]
    sha256: str | None = getattr(scan, column)
    if sha256 is None:
        raise ArtifactNotFound(
            f"The scan has no {name} yet: the job that reads it is {job.state}.",
            job_id=job.id,
            job_state=job.state,
        )
    return stored_file(kernel, session, sha256=sha256, file_name=file_name, media_type=media_type)
