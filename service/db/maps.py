"""Maps: one floor of one site each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import datetime

from sqlalchemy import func, or_, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import Map


def add_map(session: Session, row: Map) -> bool:
    """Return whether the map was added; False when its site has a map of this name."""
    try:
        with session.begin_nested():
            session.add(row)
    except IntegrityError:
        return False
    return True


def rename_map(session: Session, row: Map, *, site: str, name: str, now: datetime) -> bool:
    """Return whether the map has its new names; False when another map has them."""
    try:
        with session.begin_nested():
            row.site, row.name, row.updated_at = site, name, now
    except IntegrityError:
        return False
    return True


def find_map(session: Session, map_id: str, *, lock: bool = False) -> Map | None:
    """Return the map with this id, or None; with `lock` no other transaction changes it meanwhile."""
    return session.get(Map, map_id, with_for_update=True if lock else None)


def find_maps(session: Session, map_ids: Collection[str]) -> Sequence[Map]:
    """Return those of the ids that are maps."""
    return session.scalars(select(Map).where(Map.id.in_(map_ids))).all()


def list_maps(
    session: Session,
    *,
    covered: Collection[str] | None,
    site: str | None,
    text: str | None,
    after: str | None,
    limit: int,
) -> Sequence[Map]:
    """Return up to `limit` maps in the order of their making, after the id `after`.

    Parameters
    ----------
    covered : collection of str, optional
        Only these maps; None means all.
    site : str, optional
        Only maps of exactly this site.
    text : str, optional
        Only maps whose site or name contains this, whatever its case.
    """
    query = select(Map).order_by(Map.id).limit(limit)
    if covered is not None:
        query = query.where(Map.id.in_(covered))
    if site is not None:
        query = query.where(Map.site == site)
    if text is not None:
        lowered = text.lower()
        query = query.where(
            or_(
                func.lower(Map.name).contains(lowered, autoescape=True),
                func.lower(Map.site).contains(lowered, autoescape=True),
            )
        )
    if after is not None:
        query = query.where(Map.id > after)
    return session.scalars(query).all()
