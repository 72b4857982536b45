"""Record what a scan's job has read, and end the job with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.db.jobs import Attempt, finish_succeeded
from service.db.models import Scan
from service.db.session import Session
from service.storage.blobs import Stored
from service.usecases.kernel import Kernel
from service.usecases.record_files import record_files


def record_scan_reading(
    kernel: Kernel,
    session: Session,
    attempt: Attempt,
    *,
    reading: dict[str, Any],
    files: Mapping[str, Stored],
) -> Scan:
    """Return the scan, now with its reading; one transaction with the end of the job.

    Parameters
    ----------
    attempt : Attempt
        The attempt that read it; its subject is the scan.
    reading : dict
        Counts, extent and findings.
    files : mapping of str to Stored
        ``points.pcd``, ``preview.png`` and ``upright.npz``, in the blob store already.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    finish_succeeded(session, attempt, now=kernel.now())
    record_files(kernel, session, files)
    scan = session.get_one(Scan, attempt.subject_id)
    scan.reading = reading
    scan.points_sha256 = files["points.pcd"].sha256
    scan.upright_sha256 = files["upright.npz"].sha256
    scan.preview_sha256 = files["preview.png"].sha256
    return scan
