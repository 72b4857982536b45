"""Record where a scan was placed and how well that fits, and end the job with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from service.db.jobs import Attempt, finish_succeeded
from service.db.models import Placement
from service.db.session import Session
from service.domain.acceptance import Judgement
from service.domain.evidence import Candidate, PlacementEvidence
from service.domain.transform import Transform
from service.domain.webhook import EventKind
from service.storage.blobs import Stored
from service.usecases.events import emit
from service.usecases.kernel import Kernel
from service.usecases.proposals import propose
from service.usecases.record_files import record_files


@dataclass(frozen=True)
class PlacementResult:
    """Hold what a placement job found: the pose, what was measured there, and the judgement of it."""

    T_map_scan: Transform
    judgement: Judgement
    evidence: PlacementEvidence
    candidates: Sequence[Candidate] = ()


def record_placement(
    kernel: Kernel,
    session: Session,
    attempt: Attempt,
    *,
    result: PlacementResult,
    files: Mapping[str, Stored],
) -> Placement:
    """Return the placement, now with its verdict; one transaction with the end of the job.

    A rejected placement is a job that succeeded. An accepted one proposes to take off what it looked through.

    Parameters
    ----------
    attempt : Attempt
        The attempt that computed it; its subject is the placement.
    files : mapping of str to Stored
        ``labels.npy``, in the blob store already.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    finish_succeeded(session, attempt, now=kernel.now())
    record_files(kernel, session, files)
    placement = session.get_one(Placement, attempt.subject_id)
    judged, evidence = result.judgement.to_json(), result.evidence.to_json()
    placement.T_map_scan = result.T_map_scan.tolist()
    placement.verdict, placement.reasons = judged["verdict"], judged["reasons"]
    placement.evidence = evidence
    placement.candidates = [one.to_json() for one in result.candidates]
    placement.labels_sha256 = files["labels.npy"].sha256
    if placement.verdict == "accepted":
        propose(kernel, session, placement, evidence["gone"])
    told = {"placement_id": placement.id, "scan_id": placement.scan_id, "verdict": placement.verdict}
    emit(kernel, session, EventKind.PLACEMENT_JUDGED, map_id=placement.map_id, told=told)
    return placement
