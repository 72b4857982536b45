"""Find placements, and judge whether one may become a layer."""

from __future__ import annotations

from collections.abc import Sequence

from service.db import placements as table
from service.db.models import Placement
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import PlacementNotAcceptable, PlacementNotFound
from service.domain.reasons import kept_reasons
from service.usecases.scans import covered_scan


def covered_placement(session: Session, actor: Actor, *, placement_id: str) -> Placement:
    """Return a placement on a map that the key covers.

    Raises
    ------
    PlacementNotFound
        If there is no such placement, or the key does not cover its map.
    """
    missing = PlacementNotFound(f"There is no placement {placement_id}, or this key does not cover its map.")
    row = table.find_placement(session, placement_id)
    if row is None:
        raise missing
    actor.require_map(row.map_id, otherwise=missing)
    return row


def list_placements(
    session: Session, actor: Actor, *, scan_id: str, before: str | None, limit: int
) -> Sequence[Placement]:
    """Return up to `limit` placements of a scan, newest first, with ids before `before`.

    Raises
    ------
    ScanNotFound
        As `covered_scan`.
    """
    covered_scan(session, actor, scan_id=scan_id)
    return table.list_placements(session, scan_id, before=before, limit=limit)


def require_acceptable(row: Placement, *, reviewed: bool) -> None:
    """Pass when the placement may become a layer.

    Raises
    ------
    PlacementNotAcceptable
        If it is unfinished or rejected, or needs a review that nobody did.
    """
    if row.verdict is None or row.T_map_scan is None:
        raise PlacementNotAcceptable(
            f"The placement {row.id} has no result; its job is {row.job_id}.", verdict=None, job_id=row.job_id
        )
    if row.verdict == "rejected":
        raise PlacementNotAcceptable(
            f"The placement {row.id} was rejected; place the scan again from a better pose.",
            verdict=row.verdict,
            reasons=kept_reasons(row.reasons),
        )
    if row.verdict == "needs-review" and not reviewed:
        raise PlacementNotAcceptable(
            f"The placement {row.id} needs a review: look at it, then send reviewed = true.",
            verdict=row.verdict,
            reasons=kept_reasons(row.reasons),
        )
