"""Drawings, scans, and uploads in pieces."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.db.models import Blob, Drawing, Job, Scan, Upload
from service.db.narrowing import Narrowing, narrowed

DrawingRow = tuple[Drawing, Blob, Job]
"""A drawing with its file and its latest job."""

ScanRow = tuple[Scan, Blob, Job]
"""A scan with its file and its latest job."""


def find_drawing(session: Session, drawing_id: str, *, lock: bool = False) -> Drawing | None:
    """Return the drawing, or None; with `lock` no other transaction changes it meanwhile."""
    return session.get(Drawing, drawing_id, with_for_update=True if lock else None)


def find_drawing_row(session: Session, drawing_id: str) -> DrawingRow | None:
    """Return the drawing with its file and its latest job, or None."""
    found = session.execute(_drawing_rows().where(Drawing.id == drawing_id)).one_or_none()
    return None if found is None else (found[0], found[1], found[2])


def list_drawing_rows(
    session: Session, map_id: str, *, after: str | None, limit: int
) -> Sequence[DrawingRow]:
    """Return up to `limit` drawings of the map in the order of their making, after the id `after`."""
    query = _drawing_rows().where(Drawing.map_id == map_id).order_by(Drawing.id).limit(limit)
    if after is not None:
        query = query.where(Drawing.id > after)
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def narrowed_drawing_rows(session: Session, wanted: Narrowing) -> Sequence[DrawingRow]:
    """Return the drawings that are wanted, each with its file and its latest job."""
    query = narrowed(_drawing_rows(), Drawing, wanted, prefix="drw")
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def find_scan_row(session: Session, scan_id: str) -> ScanRow | None:
    """Return the scan with its file and its latest job, or None."""
    found = session.execute(_scan_rows().where(Scan.id == scan_id)).one_or_none()
    return None if found is None else (found[0], found[1], found[2])


def list_scan_rows(session: Session, map_id: str, *, after: str | None, limit: int) -> Sequence[ScanRow]:
    """Return up to `limit` scans of the map in the order of their making, after the id `after`."""
    query = _scan_rows().where(Scan.map_id == map_id).order_by(Scan.id).limit(limit)
    if after is not None:
        query = query.where(Scan.id > after)
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def narrowed_scan_rows(session: Session, wanted: Narrowing) -> Sequence[ScanRow]:
    """Return the scans that are wanted, each with its file and its latest job."""
    query = narrowed(_scan_rows(), Scan, wanted, prefix="scn")
    return [(row[0], row[1], row[2]) for row in session.execute(query)]


def find_upload(session: Session, upload_id: str, *, lock: bool = False) -> Upload | None:
    """Return the upload in pieces, or None; with `lock` no other transaction changes it meanwhile."""
    return session.get(Upload, upload_id, with_for_update=True if lock else None)


def expired_uploads(session: Session, *, before: datetime) -> Sequence[Upload]:
    """Return the uploads whose time has run out."""
    return session.scalars(select(Upload).where(Upload.expires_at <= before).order_by(Upload.id)).all()


def _drawing_rows() -> Select[Drawing, Blob, Job]:
    """Return a query of drawings, each with its file and its latest job."""
    return (
        select(Drawing, Blob, Job)
        .join(Blob, Blob.sha256 == Drawing.blob_sha256)
        .join(Job, Job.id == Drawing.job_id)
    )


def _scan_rows() -> Select[Scan, Blob, Job]:
    """Return a query of scans, each with its file and its latest job."""
    return (
        select(Scan, Blob, Job).join(Blob, Blob.sha256 == Scan.blob_sha256).join(Job, Job.id == Scan.job_id)
    )
