"""Record what a drawing's job has read, and end the job with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.db.jobs import Attempt, finish_succeeded
from service.db.models import Drawing
from service.db.session import Session
from service.storage.blobs import Stored
from service.usecases.kernel import Kernel
from service.usecases.record_files import record_files


def record_drawing_reading(
    kernel: Kernel,
    session: Session,
    attempt: Attempt,
    *,
    reading: dict[str, Any],
    files: Mapping[str, Stored],
) -> Drawing:
    """Return the drawing, now with its reading; one transaction with the end of the job.

    Where the drawing has been asked to be read anew meanwhile, the job ends and the drawing stays.

    Parameters
    ----------
    attempt : Attempt
        The attempt that read it; its subject is the drawing.
    reading : dict
        What ``reading.json`` says.
    files : mapping of str to Stored
        ``walls.geojson``, ``removed.geojson`` and ``preview.png``, in the blob store already; of a sheet of
        pixels ``sheet.json`` and ``sheet.bin`` too.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    finish_succeeded(session, attempt, now=kernel.now())
    record_files(kernel, session, files)
    drawing = session.get_one(Drawing, attempt.subject_id, with_for_update=True)
    if drawing.job_id != attempt.job_id:
        return drawing
    drawing.reading = reading
    drawing.walls_sha256 = files["walls.geojson"].sha256
    drawing.removed_sha256 = files["removed.geojson"].sha256
    drawing.sheet_sha256 = files["sheet.json"].sha256 if "sheet.json" in files else None
    drawing.tiles_sha256 = files["sheet.bin"].sha256 if "sheet.bin" in files else None
    drawing.preview_sha256 = files["preview.png"].sha256
    return drawing
