"""Find, list and read again the drawings of a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from service.db import uploads as table
from service.db.jobs import enqueue, request_cancel
from service.db.models import Drawing, Job
from service.db.session import Session
from service.db.uploads import DrawingRow
from service.domain.access import Actor
from service.domain.drawing_options import DrawingOptions
from service.domain.errors import ArtifactNotFound, DrawingNotFound, InvalidRequest
from service.domain.lifecycle import JobKind, JobState, Role
from service.usecases.audit import record
from service.usecases.download import StoredFile, stored_file
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map

_FILES = {
    "preview.png": ("preview_sha256", "image/png", "preview.png"),
    "walls.geojson": ("walls_sha256", "application/geo+json", "walls.geojson"),
    "sheet.json": ("sheet_sha256", "application/json", "sheet.json"),
    "sheet.bin": ("tiles_sha256", "application/octet-stream", "sheet.bin"),
    "removed.geojson": ("removed_sha256", "application/geo+json", "removed.geojson"),
}


def covered_drawing(session: Session, actor: Actor, *, drawing_id: str) -> DrawingRow:
    """Return a drawing that exists and whose map the key covers, with its file and its latest job.

    Raises
    ------
    DrawingNotFound
        If there is none: missing and not covered cannot be told apart.
    """
    missing = DrawingNotFound(f"There is no drawing {drawing_id}, or this key does not cover its map.")
    row = table.find_drawing_row(session, drawing_id)
    if row is None:
        raise missing
    actor.require_map(row[0].map_id, otherwise=missing)
    return row


def list_drawings(
    session: Session, actor: Actor, *, map_id: str, after: str | None, limit: int
) -> Sequence[DrawingRow]:
    """Return up to `limit` drawings of the map, in the order of their making.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    covered_map(session, actor, map_id=map_id)
    return table.list_drawing_rows(session, map_id, after=after, limit=limit)


def drawing_file(kernel: Kernel, session: Session, actor: Actor, *, drawing_id: str, name: str) -> StoredFile:
    """Return a file of the drawing's latest finished reading.

    Raises
    ------
    DrawingNotFound
        If there is no such drawing for the key.
    ArtifactNotFound
        If a reading has no such file, or the drawing no finished reading yet.
    """
    drawing, _, job = covered_drawing(session, actor, drawing_id=drawing_id)
    if name not in _FILES:
        raise ArtifactNotFound(f"A drawing has no file {name!r}; it has {', '.join(sorted(_FILES))}.")
    column, media_type, file_name = _FILES[name]
    sha256: str | None = getattr(drawing, column)
    if sha256 is None:
        lines = "it is lines, not pixels, or was read before these were kept"
        why = lines if drawing.reading is not None else f"the job that reads it is {job.state}"
        raise ArtifactNotFound(
            f"The drawing has no {name}: {why}.",
            job_id=job.id,
            job_state=job.state,
        )
    return stored_file(kernel, session, sha256=sha256, file_name=file_name, media_type=media_type)


def reread_drawing(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    drawing_id: str,
    change: Callable[[DrawingOptions], DrawingOptions],
) -> DrawingRow:
    """Return the drawing with its changed options and the job that reads it anew.

    The earlier reading stays until the new one is done; an earlier job that has not ended is cancelled.

    Parameters
    ----------
    change : callable
        Gives the new options from the present ones.

    Raises
    ------
    Forbidden
        If the actor is neither a tablet nor an admin.
    DrawingNotFound
        If there is no such drawing for the key.
    InvalidRequest
        As `change`.
    StorageFull
        If there is no room for what its job makes.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    drawing, blob, _ = covered_drawing(session, actor, drawing_id=drawing_id)
    earlier = _lock(session, drawing)
    before = DrawingOptions.from_json(drawing.options)
    options = change(before)
    if options.replaces != before.replaces:
        detail = "Which drawing this one replaces is said when it is uploaded, and stays."
        raise InvalidRequest(detail, errors=[{"pointer": "#/replaces", "detail": detail}])
    kernel.room.require()
    now = kernel.now()
    if not JobState(earlier.state).is_final:
        request_cancel(session, earlier.id, now=now)
    job = enqueue(
        session,
        JobKind.READ_DRAWING,
        job_id=kernel.new_id("job"),
        map_id=drawing.map_id,
        subject_id=drawing.id,
        key_id=actor.key_id,
        now=now,
    )
    drawing.options, drawing.job_id = options.to_json(), job.id
    session.flush()
    record(
        kernel,
        session,
        actor,
        action="reread-drawing",
        subject_id=drawing.id,
        map_id=drawing.map_id,
        before={"options": before.to_json()},
        after={"options": drawing.options},
    )
    return drawing, blob, job


def _lock(session: Session, drawing: Drawing) -> Job:
    """Return the drawing's latest job; both rows are locked, the job first, as a worker's record does."""
    while True:
        job = session.get_one(Job, drawing.job_id, with_for_update=True, populate_existing=True)
        session.refresh(drawing, with_for_update=True)
        if drawing.job_id == job.id:
            return job
