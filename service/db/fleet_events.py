"""What happened in the fleet, by the time-ordered ids of publications and reports."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.db.models import Publication
from service.db.robots import Robot, RobotReport

_BATCH = 500


def publications_behind(
    session: Session, after: str, *, covered: Collection[str] | None, limit: int
) -> Sequence[Publication]:
    """Return up to `limit` moves of pointers with ids after `after`, of the maps `covered` (None: all)."""
    query = select(Publication).where(Publication.id > after).order_by(Publication.id).limit(limit)
    if covered is not None:
        query = query.where(Publication.map_id.in_(covered))
    return session.scalars(query).all()


def reports_behind(
    session: Session, after: str, *, covered: Collection[str] | None, limit: int
) -> Sequence[tuple[RobotReport, str]]:
    """Return up to `limit` reports with ids after `after`, each with its robot's map."""
    query = _reports().where(RobotReport.id > after).order_by(RobotReport.id).limit(limit)
    if covered is not None:
        query = query.where(Robot.map_id.in_(covered))
    return [(row[0], row[1]) for row in session.execute(query)]


def ids_behind(session: Session, publication: str, report: str) -> list[str]:
    """Return the ids of all publications after the one and of all reports after the other."""
    publications = select(Publication.id).where(Publication.id > publication)
    reports = select(RobotReport.id).where(RobotReport.id > report)
    return [*session.scalars(publications), *session.scalars(reports)]


def find_publications(session: Session, ids: Sequence[str]) -> list[Publication]:
    """Return the publications with these ids."""
    return [
        row
        for part in _parts(ids)
        for row in session.scalars(select(Publication).where(Publication.id.in_(part)))
    ]


def find_reports(session: Session, ids: Sequence[str]) -> list[tuple[RobotReport, str]]:
    """Return the reports with these ids, each with its robot's map."""
    return [
        (row[0], row[1])
        for part in _parts(ids)
        for row in session.execute(_reports().where(RobotReport.id.in_(part)))
    ]


def _reports() -> Select[RobotReport, str]:
    return select(RobotReport, Robot.map_id).join(Robot, Robot.id == RobotReport.robot_id)


def _parts(ids: Sequence[str]) -> list[Sequence[str]]:
    return [ids[begin : begin + _BATCH] for begin in range(0, len(ids), _BATCH)]
