"""Ask for a scan to be placed on a revision: the placement's row and its job."""

from __future__ import annotations

from dataclasses import dataclass

from service.db import revisions as revision_table
from service.db.jobs import enqueue
from service.db.models import Job, Placement, Scan
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import InvalidRequest, RevisionNotReady, ScanNotRead
from service.domain.lifecycle import JobKind, RevisionStatus, Role
from service.domain.rough_pose import RoughPose
from service.usecases.audit import record
from service.usecases.kernel import Kernel
from service.usecases.revisions import ready_revision
from service.usecases.scans import covered_scan


@dataclass(frozen=True)
class WantedPlacement:
    """Hold how a scan is asked to be placed.

    Parameters
    ----------
    rough_pose : RoughPose, optional
        Where to look; by default the pose that came with the scan, and everywhere where there is none.
    search : bool
        Whether to look everywhere, whatever came with the scan.
    revision_n : int, optional
        What to place it on; by default the map's latest ready revision.
    ndt_resolution_m : float
        Edge of a cell of the NDT map [m]; the paper takes 1.
    """

    rough_pose: RoughPose | None = None
    search: bool = False
    revision_n: int | None = None
    ndt_resolution_m: float = 1.0


@dataclass(frozen=True)
class Asked:
    """Hold a new placement and the job that computes it."""

    placement: Placement
    job: Job


def place(kernel: Kernel, session: Session, actor: Actor, *, scan_id: str, wanted: WantedPlacement) -> Asked:
    """Return a new placement of the scan and its queued job.

    Raises
    ------
    Forbidden
        If the key is a robot's.
    ScanNotFound
        If there is no such scan for the key.
    ScanNotRead
        If the scan's reading has not finished.
    RevisionNotFound
        If the map has no such revision.
    StorageFull
        If there is no room for what its job makes.
    RevisionNotReady
        If the revision is building or failed, or the map has no ready one.
    InvalidRequest
        If a rough pose is given and a search everywhere is asked for as well.
    """
    actor.require_role(Role.TABLET, Role.ADMIN)
    scan, _, _ = covered_scan(session, actor, scan_id=scan_id)
    pose = _start(scan, wanted)
    if scan.reading is None:
        raise ScanNotRead(
            f"The scan {scan_id} has no finished reading; its job is {scan.job_id}.", job_id=scan.job_id
        )
    n = _target(session, actor, scan.map_id, wanted.revision_n)
    kernel.room.require()
    now = kernel.now()
    placement_id = kernel.new_id("plc")
    job = enqueue(
        session,
        JobKind.PLACE_SCAN,
        job_id=kernel.new_id("job"),
        map_id=scan.map_id,
        subject_id=placement_id,
        key_id=actor.key_id,
        now=now,
    )
    row = Placement(
        id=placement_id,
        map_id=scan.map_id,
        scan_id=scan_id,
        revision_n=n,
        job_id=job.id,
        initial_pose=None if pose is None else pose.to_json(),
        ndt_resolution_m=wanted.ndt_resolution_m,
        created_at=now,
        created_by=actor.key_id,
    )
    session.add(row)
    session.flush()
    after = {"scan_id": scan_id, "revision": n, "initial_pose": row.initial_pose}
    record(kernel, session, actor, action="place-scan", subject_id=row.id, map_id=scan.map_id, after=after)
    return Asked(row, job)


def _start(scan: Scan, wanted: WantedPlacement) -> RoughPose | None:
    """Return the rough pose to look around, or None to look everywhere."""
    if wanted.search and wanted.rough_pose is not None:
        detail = "Give rough_pose, or search = true, but not both."
        raise InvalidRequest(detail, errors=[{"pointer": "#/search", "detail": detail}])
    if wanted.search:
        return None
    if wanted.rough_pose is not None:
        return wanted.rough_pose
    return None if scan.rough_pose is None else RoughPose.from_json(scan.rough_pose)


def _target(session: Session, actor: Actor, map_id: str, n: int | None) -> int:
    if n is not None:
        return ready_revision(session, actor, map_id=map_id, n=n).n
    latest = revision_table.latest_revision(session, map_id, status=RevisionStatus.READY)
    if latest is None:
        raise RevisionNotReady(f"The map {map_id} has no ready revision to place a scan on.", status=None)
    return latest.n
