"""Make a built revision ready with its artifacts, and end the job with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from service.db.jobs import Attempt, LeaseLost, finish_succeeded
from service.db.models import Revision
from service.db.revisions import lock_revision
from service.db.session import Session
from service.domain.lifecycle import RevisionStatus
from service.domain.webhook import EventKind
from service.storage.blobs import Stored
from service.usecases.events import emit
from service.usecases.kernel import Kernel
from service.usecases.rebuild import files_digest
from service.usecases.record_files import artifact_rows, record_files


def record_revision(
    kernel: Kernel,
    session: Session,
    attempt: Attempt,
    *,
    report: dict[str, Any],
    version: str,
    files: Mapping[str, Stored],
) -> Revision:
    """Return the revision, now ready; one transaction with the end of the job.

    Parameters
    ----------
    attempt : Attempt
        The attempt that built it; its subject is the revision.
    report : dict
        What ``report.json`` says.
    version : str
        Of the software that built it.
    files : mapping of str to Stored
        The artifacts by their path, in the blob store already.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's, or the revision is final: nothing is recorded.
    """
    now = kernel.now()
    finish_succeeded(session, attempt, now=now)
    record_files(kernel, session, files)
    revision = lock_revision(session, attempt.subject_id)
    if revision.job_id != attempt.job_id or revision.status != RevisionStatus.BUILDING:
        raise LeaseLost(attempt.job_id)
    revision.status, revision.report, revision.ended_at = RevisionStatus.READY.value, report, now
    revision.software_version = version
    revision.artifacts_sha256 = files_digest({path: stored.sha256 for path, stored in files.items()})
    session.add_all(artifact_rows(revision.id, files))
    told = {"revision": revision.n, "job_id": revision.job_id}
    emit(kernel, session, EventKind.REVISION_READY, map_id=revision.map_id, told=told)
    return revision
