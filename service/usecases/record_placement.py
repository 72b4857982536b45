"""Record where a scan was placed and how well that fits, and end the job with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.db.jobs import Attempt, finish_succeeded
from service.db.models import Placement
from service.db.session import Session
from service.domain.webhook import EventKind
from service.storage.blobs import Stored
from service.usecases.events import emit
from service.usecases.kernel import Kernel
from service.usecases.proposals import propose
from service.usecases.record_files import record_files


@dataclass(frozen=True)
class PlacementResult:
    """Hold what a placement job found, as JSON values; `T_map_scan` is a 4x4 matrix [m]."""

    T_map_scan: list[list[float]]
    verdict: str
    reasons: list[Any]
    evidence: dict[str, Any]
    candidates: list[Any]


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
    placement.T_map_scan = result.T_map_scan
    placement.verdict = result.verdict
    placement.reasons = result.reasons
    placement.evidence = result.evidence
    placement.candidates = result.candidates
    placement.labels_sha256 = files["labels.npy"].sha256
    if result.verdict == "accepted":
        propose(kernel, session, placement, result.evidence.get("gone", ()))
    told = {"placement_id": placement.id, "scan_id": placement.scan_id, "verdict": result.verdict}
    emit(kernel, session, EventKind.PLACEMENT_JUDGED, map_id=placement.map_id, told=told)
    return placement
