"""Placements of scans."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Placement
from service.db.narrowing import Narrowing, narrowed


def find_placement(session: Session, placement_id: str) -> Placement | None:
    """Return the placement with this id, or None."""
    return session.get(Placement, placement_id)


def find_placements(session: Session, placement_ids: Collection[str]) -> dict[str, Placement]:
    """Return those of the ids that are placements, by id."""
    rows = session.scalars(select(Placement).where(Placement.id.in_(placement_ids)))
    return {row.id: row for row in rows}


def narrowed_placements(session: Session, wanted: Narrowing) -> Sequence[Placement]:
    """Return the placements that are wanted."""
    return session.scalars(narrowed(select(Placement), Placement, wanted, prefix="plc")).all()


def list_placements(session: Session, scan_id: str, *, before: str | None, limit: int) -> Sequence[Placement]:
    """Return up to `limit` placements of a scan, newest first, with ids before `before`."""
    query = select(Placement).where(Placement.scan_id == scan_id).order_by(Placement.id.desc()).limit(limit)
    if before is not None:
        query = query.where(Placement.id < before)
    return session.scalars(query).all()
