"""Take in a drawing: its row and the job that reads it, in one transaction."""

from __future__ import annotations

from dataclasses import dataclass

from service.db.jobs import enqueue
from service.db.models import Drawing, Job
from service.db.session import Session
from service.db.uploads import find_drawing
from service.domain.access import Actor
from service.domain.drawing_options import DrawingOptions
from service.domain.errors import InvalidRequest
from service.domain.lifecycle import JobKind
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.receive_file import ReceivedFile, record_file, require_receiver


@dataclass(frozen=True)
class ReceivedDrawing:
    """Hold a new drawing and the job that will read it."""

    drawing: Drawing
    job: Job


def receive_drawing(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    map_id: str,
    file: ReceivedFile,
    options: DrawingOptions,
) -> ReceivedDrawing:
    """Return the new drawing of a map and its queued job.

    Parameters
    ----------
    file : ReceivedFile
        Its bytes are in the blob store already: bytes first, rows second.
    options : DrawingOptions
        What the sender said of the drawing. Where it replaces another, what was said of that one and is not
        said anew is taken over, corrections included.

    Raises
    ------
    Forbidden
        If the actor is neither a tablet nor an admin.
    MapNotFound
        If there is no such map, or the actor's key does not cover it.
    InvalidRequest
        If the drawing that this one replaces is none of the map's.
    """
    require_receiver(session, actor, map_id)
    options = _completed(session, map_id, options)
    now = kernel.now()
    record_file(kernel, session, file)
    drawing_id = kernel.new_id("drw")
    job = enqueue(
        session,
        JobKind.READ_DRAWING,
        job_id=kernel.new_id("job"),
        map_id=map_id,
        subject_id=drawing_id,
        key_id=actor.key_id,
        now=now,
    )
    drawing = Drawing(
        id=drawing_id,
        map_id=map_id,
        file_name=file.file_name,
        blob_sha256=file.sha256,
        options=options.to_json(),
        job_id=job.id,
        created_at=now,
        created_by=actor.key_id,
    )
    session.add(drawing)
    session.flush()
    after = {"file_name": file.file_name, "sha256": file.sha256, "options": drawing.options}
    record(
        kernel, session, actor, action="receive-drawing", subject_id=drawing_id, map_id=map_id, after=after
    )
    return ReceivedDrawing(drawing, job)


def _completed(session: Session, map_id: str, options: DrawingOptions) -> DrawingOptions:
    """Return the options, completed by those of the drawing of which this is a new issue."""
    if options.replaces is None:
        return options
    earlier = find_drawing(session, options.replaces)
    if earlier is None or earlier.map_id != map_id:
        detail = f"The map has no drawing {options.replaces} that could be replaced."
        raise InvalidRequest(detail, errors=[{"pointer": "#/replaces", "detail": detail}])
    return options.completed_by(DrawingOptions.from_json(earlier.options))
