"""Show, cancel and retry jobs."""

from __future__ import annotations

from service.db import job_lists
from service.db.jobs import request_cancel, retry
from service.db.models import Job
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import JobNotFound
from service.domain.lifecycle import Role
from service.usecases.audit import record
from service.usecases.kernel import Kernel


def covered_job(session: Session, actor: Actor, *, job_id: str) -> Job:
    """Return a job of a map that the key covers.

    Raises
    ------
    JobNotFound
        If there is no such job, or the key does not cover its map.
    """
    missing = JobNotFound(f"There is no job {job_id}, or this key does not cover its map.")
    row = job_lists.find_job(session, job_id)
    if row is None:
        raise missing
    actor.require_map(row.map_id, otherwise=missing)
    return row


def cancel_job(kernel: Kernel, session: Session, actor: Actor, *, job_id: str) -> Job:
    """Return the job, cancelled if it was waiting, else about to be stopped by its worker.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    JobNotFound
        If there is no such job for the key.
    JobNotCancellable
        If the job has ended.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    row = covered_job(session, actor, job_id=job_id)
    before = row.state
    job = request_cancel(session, job_id, now=kernel.now())
    _record(kernel, session, actor, job, action="cancel-job", before=before)
    return job


def retry_job(kernel: Kernel, session: Session, actor: Actor, *, job_id: str) -> Job:
    """Return the failed or cancelled job, queued anew.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    JobNotFound
        If there is no such job for the key.
    JobNotRetryable
        If the job did not fail and was not cancelled, or it built a revision.
    StorageFull
        If there is no room for what it makes.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    row = covered_job(session, actor, job_id=job_id)
    before = row.state
    kernel.room.require()
    job = retry(session, job_id, now=kernel.now())
    _record(kernel, session, actor, job, action="retry-job", before=before)
    return job


def _record(kernel: Kernel, session: Session, actor: Actor, job: Job, *, action: str, before: str) -> None:
    record(
        kernel,
        session,
        actor,
        action=action,
        subject_id=job.id,
        map_id=job.map_id,
        before={"state": before},
        after={"state": job.state},
    )
