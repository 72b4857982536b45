"""Build a revision again from its inputs: the proof that it is what it says; it brings pruned files back."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from service.db import revisions as table
from service.db.jobs import Attempt, enqueue, finish_succeeded
from service.db.models import Job, Revision
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import RebuiltDifferently, RevisionNotReady
from service.domain.lifecycle import JobKind, RevisionStatus, Role
from service.storage.blobs import Stored
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.record_files import artifact_rows, record_files
from service.usecases.revisions import covered_revision


def rebuild(kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int) -> Job:
    """Return the job that builds a ready revision again and compares every file with the recorded one.

    Raises
    ------
    Forbidden
        If the actor is no admin.
    MapNotFound, RevisionNotFound
        As `covered_revision`.
    RevisionNotReady
        If it is still building, or failed.
    StorageFull
        If there is no room for its files.
    """
    actor.require_role(Role.ADMIN)
    row = covered_revision(session, actor, map_id=map_id, n=n)
    if row.status != RevisionStatus.READY:
        raise RevisionNotReady(
            f"Revision {n} is {row.status}; its job is {row.job_id}.", status=row.status, job_id=row.job_id
        )
    kernel.room.require()
    job = enqueue(
        session,
        JobKind.REBUILD_REVISION,
        job_id=kernel.new_id("job"),
        map_id=map_id,
        subject_id=row.id,
        key_id=actor.key_id,
        now=kernel.now(),
    )
    record(kernel, session, actor, action="rebuild-revision", subject_id=row.id, map_id=map_id)
    return job


def record_rebuild(
    kernel: Kernel, session: Session, attempt: Attempt, *, version: str, files: Mapping[str, Stored]
) -> None:
    """Compare the files that were built again with the recorded ones, and bring pruned ones back.

    Parameters
    ----------
    version : str
        Of the software that built them now.
    files : mapping of str to Stored
        By their path, in the blob store already.

    Raises
    ------
    RebuiltDifferently
        If a file has other bytes than it had.
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    now = kernel.now()
    revision = table.lock_revision(session, attempt.subject_id)
    _require_same(session, revision, files, version)
    finish_succeeded(session, attempt, now=now)
    if revision.pruned_at is not None:
        record_files(kernel, session, files)
        session.add_all(artifact_rows(revision.id, files))
        revision.pruned_at = None


def files_digest(files: Mapping[str, str]) -> str:
    """Return one SHA-256 (hex) over all files of a revision: over the lines `<sha256>  <path>`, by path."""
    lines = [f"{sha256}  {path}\n" for path, sha256 in sorted(files.items())]
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def _require_same(session: Session, revision: Revision, files: Mapping[str, Stored], version: str) -> None:
    built = {path: stored.sha256 for path, stored in files.items()}
    recorded = {row.path: row.sha256 for row in table.list_artifacts(session, revision.id)}
    differing = sorted(p for p in recorded | built if recorded.get(p) != built.get(p))
    if revision.pruned_at is not None:
        differing = [] if files_digest(built) == revision.artifacts_sha256 else sorted(built)
    if differing:
        raise RebuiltDifferently(
            f"Of revision {revision.n}, {len(differing)} of {len(built)} files were built with other bytes; "
            f"it was built by version {revision.software_version or 'unknown'}, and now by {version}.",
            paths=differing[:100],
            built_with=revision.software_version,
            rebuilt_with=version,
        )
