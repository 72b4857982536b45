"""Give a revision's cloud in another format; made once, on request, by a job."""

from __future__ import annotations

from dataclasses import dataclass

from service.db.blobs import record_blob
from service.db.exports import Export, find_export
from service.db.job_lists import find_job
from service.db.jobs import Attempt, enqueue, finish_succeeded
from service.db.models import Job
from service.db.revisions import find_artifact
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import ArtifactNotFound, ExportNotReady
from service.domain.lifecycle import ExportFormat, JobKind, JobState
from service.storage.blobs import Stored
from service.usecases.download import CLOUD_PATH, StoredFile
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.revisions import ready_revision

MEDIA_TYPE = "application/octet-stream"
_RETRY_S, _RETRY_FAILED_S = 1, 3600


@dataclass(frozen=True)
class Asked:
    """Hold an export with the job that makes or made it."""

    export: Export
    job: Job


def ask_for_export(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int, kind: ExportFormat
) -> Asked:
    """Return the export of a ready revision; the first who asks begins it.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady, RevisionPruned
        As `ready_revision`.
    ArtifactNotFound
        If the revision has no cloud.
    StorageFull
        If it has still to be made, and there is no room.
    """
    covered_map(session, actor, map_id=map_id, lock=True)
    revision = ready_revision(session, actor, map_id=map_id, n=n)
    if find_artifact(session, revision.id, path=CLOUD_PATH) is None:
        raise ArtifactNotFound(f"Revision {n} has no {CLOUD_PATH}.")
    found = find_export(session, revision_id=revision.id, kind=kind)
    if found is not None:
        return Asked(found, _job(session, found))
    kernel.room.require()
    now, export_id = kernel.now(), kernel.new_id("exp")
    job = enqueue(
        session,
        JobKind.EXPORT_CLOUD,
        job_id=kernel.new_id("job"),
        map_id=map_id,
        subject_id=export_id,
        key_id=actor.key_id,
        now=now,
    )
    export = Export(id=export_id, revision_id=revision.id, format=kind.value, job_id=job.id, created_at=now)
    session.add(export)
    session.flush()
    return Asked(export, job)


def export_file(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int, kind: ExportFormat
) -> StoredFile:
    """Return an export that was asked for.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady, RevisionPruned
        As `ready_revision`.
    ArtifactNotFound
        If nobody has asked for it.
    ExportNotReady
        If it is still being made, or could not be.
    """
    revision = ready_revision(session, actor, map_id=map_id, n=n)
    found = find_export(session, revision_id=revision.id, kind=kind)
    if found is None:
        raise ArtifactNotFound(f"Nobody has asked for revision {n} as {kind.value}: POST to its exports.")
    if found.sha256 is None or found.size_bytes is None:
        job = _job(session, found)
        has_failed = job.state in {JobState.FAILED, JobState.CANCELLED}
        raise ExportNotReady(
            f"The export could not be made; its job is {job.id}."
            if has_failed
            else "The export is being made; ask again in a moment.",
            job_id=job.id,
            retry_after_s=_RETRY_FAILED_S if has_failed else _RETRY_S,
        )
    name = f"revision-{n}.{kind.value}"
    return StoredFile(kernel.blobs.path(found.sha256), found.sha256, found.size_bytes, MEDIA_TYPE, name)


def record_export(kernel: Kernel, session: Session, attempt: Attempt, *, stored: Stored) -> None:
    """Keep an export that was made, in one transaction with the end of its job.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    now = kernel.now()
    finish_succeeded(session, attempt, now=now)
    record_blob(session, stored.sha256, size_bytes=stored.size_bytes, media_type=MEDIA_TYPE, now=now)
    row = session.get_one(Export, attempt.subject_id)
    row.sha256, row.size_bytes = stored.sha256, stored.size_bytes


def _job(session: Session, export: Export) -> Job:
    job = find_job(session, export.job_id)
    assert job is not None
    return job
