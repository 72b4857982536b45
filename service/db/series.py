"""How many things were made in each hour or day of a period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from service.db.models import Drawing, Job, Placement, Revision, Scan
from service.db.robots import RobotReport
from service.domain.ids import first_id_at

Bucket = Literal["hour", "day"]
Counted = Literal["jobs", "drawings", "scans", "placements", "revisions", "reports"]

_FORMATS = {"hour": "%Y-%m-%dT%H:00:00+00:00", "day": "%Y-%m-%dT00:00:00+00:00"}


@dataclass(frozen=True)
class Point:
    """Hold how many things of one state were made in the hour or day that begins at `at`."""

    at: datetime
    state: str | None
    number: int


_TABLES: dict[str, tuple[Any, str, str, Any]] = {
    "jobs": (Job, "job", "created_at", Job.state),
    "drawings": (Drawing, "drw", "created_at", None),
    "scans": (Scan, "scn", "created_at", None),
    "placements": (Placement, "plc", "created_at", Placement.verdict),
    "revisions": (Revision, "rev", "created_at", Revision.status),
    "reports": (RobotReport, "rep", "at", RobotReport.state),
}


def series(
    session: Session,
    what: Counted,
    *,
    bucket: Bucket,
    period: tuple[datetime, datetime],
) -> Sequence[Point]:
    """Return the counts of each hour or day in which something was made, oldest first, by state.

    The table's ids sort by time, so that only the period's rows are read.
    """
    table, prefix, column, state = _TABLES[what]
    at = _bucket(session, getattr(table, column), bucket)
    columns = [at, *([] if state is None else [state]), func.count()]
    since, until = period
    query = select(*columns).where(
        table.id >= first_id_at(prefix, since), table.id < first_id_at(prefix, until)
    )
    rows = session.execute(query.group_by(*columns[:-1]).order_by(*columns[:-1])).all()
    return [Point(_moment(row[0]), None if state is None else row[1], row[-1]) for row in rows]


def _bucket(session: Session, column: Any, bucket: Bucket) -> ColumnElement[Any]:
    if session.get_bind().dialect.name == "postgresql":
        return func.date_trunc(bucket, column, "UTC")
    return func.strftime(_FORMATS[bucket], column)


def _moment(value: Any) -> datetime:
    found = datetime.fromisoformat(value) if isinstance(value, str) else value
    return found.astimezone(UTC)
