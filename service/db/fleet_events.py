"""What happened in the fleet, by the time-ordered ids of publications and reports."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Publication
from service.db.robots import Robot, RobotReport


def publications_behind(
    session: Session, after: str, *, covered: Collection[str] | None, limit: int
) -> Sequence[Publication]:
    """Return up to `limit` moves of pointers with ids behind `after`, of the maps `covered` (None: all)."""
    query = select(Publication).where(Publication.id > after).order_by(Publication.id).limit(limit)
    if covered is not None:
        query = query.where(Publication.map_id.in_(covered))
    return session.scalars(query).all()


def reports_behind(
    session: Session, after: str, *, covered: Collection[str] | None, limit: int
) -> Sequence[tuple[RobotReport, str]]:
    """Return up to `limit` reports with ids behind `after`, each with its robot's map."""
    query = (
        select(RobotReport, Robot.map_id)
        .join(Robot, Robot.id == RobotReport.robot_id)
        .where(RobotReport.id > after)
        .order_by(RobotReport.id)
        .limit(limit)
    )
    if covered is not None:
        query = query.where(Robot.map_id.in_(covered))
    return [(row[0], row[1]) for row in session.execute(query)]
