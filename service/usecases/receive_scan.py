"""Take in a tablet scan: its row and the job that reads it, in one transaction."""

from __future__ import annotations

from dataclasses import dataclass

from service.db.jobs import enqueue
from service.db.models import Job, Scan
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import JobKind
from service.domain.scan_options import SaidOfScan
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.receive_file import ReceivedFile, record_file, require_receiver


@dataclass(frozen=True)
class ReceivedScan:
    """Hold a new scan and the job that will read it."""

    scan: Scan
    job: Job


def receive_scan(
    kernel: Kernel,
    session: Session,
    actor: Actor,
    *,
    map_id: str,
    file: ReceivedFile,
    said: SaidOfScan,
) -> ReceivedScan:
    """Return the new scan of a map and its queued job.

    Parameters
    ----------
    file : ReceivedFile
        Its bytes are in the blob store already: bytes first, rows second.
    said : SaidOfScan
        Where the sender thinks the scan was taken, and how its file is meant.

    Raises
    ------
    Forbidden
        If the actor is neither a tablet nor an admin.
    MapNotFound
        If there is no such map, or the actor's key does not cover it.
    """
    require_receiver(session, actor, map_id)
    now = kernel.now()
    record_file(kernel, session, file)
    scan_id = kernel.new_id("scn")
    job = enqueue(
        session,
        JobKind.READ_SCAN,
        job_id=kernel.new_id("job"),
        map_id=map_id,
        subject_id=scan_id,
        key_id=actor.key_id,
        now=now,
    )
    scan = Scan(
        id=scan_id,
        map_id=map_id,
        file_name=file.file_name,
        blob_sha256=file.sha256,
        rough_pose=None if said.rough_pose is None else said.rough_pose.to_json(),
        options=said.options.to_json(),
        job_id=job.id,
        created_at=now,
        created_by=actor.key_id,
    )
    session.add(scan)
    session.flush()
    after = {"file_name": file.file_name, "sha256": file.sha256, "rough_pose": scan.rough_pose}
    record(kernel, session, actor, action="receive-scan", subject_id=scan_id, map_id=map_id, after=after)
    return ReceivedScan(scan, job)
