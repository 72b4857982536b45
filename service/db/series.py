"""How many things were made in each hour or day of a period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Literal

from sqlalchemy import Integer, String, and_, column, func, literal, select, values
from sqlalchemy.orm import Session

from service.db.models import Drawing, Job, Placement, Revision, Scan
from service.db.robots import RobotReport
from service.domain.ids import first_id_at

Bucket = Literal["hour", "day"]
Counted = Literal["jobs", "drawings", "scans", "placements", "revisions", "reports"]

_STEPS = {"hour": timedelta(hours=1), "day": timedelta(days=1)}


@dataclass(frozen=True)
class Point:
    """Hold how many things of one state were made in the hour or day that begins at `at`."""

    at: datetime
    state: str | None
    number: int


_TABLES: dict[str, tuple[Any, str, Any]] = {
    "jobs": (Job, "job", Job.state),
    "drawings": (Drawing, "drw", literal(None)),
    "scans": (Scan, "scn", literal(None)),
    "placements": (Placement, "plc", Placement.verdict),
    "revisions": (Revision, "rev", Revision.status),
    "reports": (RobotReport, "rep", RobotReport.state),
}


def series(
    session: Session, what: Counted, *, bucket: Bucket, period: tuple[datetime, datetime]
) -> Sequence[Point]:
    """Return the counts of each hour or day (UTC) in which something was made, oldest first, by state.

    Ids sort by time: each hour or day is a range of the primary key, and nothing outside the period is read.
    """
    table, prefix, state = _TABLES[what]
    begins = _begins(bucket, period)
    ends = [*begins[1:], period[1]]
    ranges = (
        values(column("number", Integer), column("low", String), column("high", String), name="ranges")
        .data(
            [
                (number, first_id_at(prefix, max(begin, period[0])), first_id_at(prefix, end))
                for number, (begin, end) in enumerate(zip(begins, ends, strict=True))
            ]
        )
        .cte("ranges")
    )
    of_range = and_(table.id >= ranges.c.low, table.id < ranges.c.high)
    query = select(ranges.c.number, state, func.count()).join(table, of_range)
    rows = session.execute(query.group_by(ranges.c.number, state)).all()
    found = sorted((number, told or "", told, count) for number, told, count in rows)
    return [Point(begins[number], told, count) for number, _, told, count in found]


def _begins(bucket: Bucket, period: tuple[datetime, datetime]) -> list[datetime]:
    """Return when each hour or day that meets the period begins."""
    since, until = (moment.astimezone(UTC) for moment in period)
    begin = since.replace(minute=0, second=0, microsecond=0)
    if bucket == "day":
        begin = begin.replace(hour=0)
    begins = []
    while begin < until:
        begins.append(begin)
        begin += _STEPS[bucket]
    return begins
