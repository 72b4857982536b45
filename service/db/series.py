"""How many things were made in each hour or day of a period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from math import ceil
from typing import Any, Literal, get_args

from sqlalchemy import Integer, String, and_, column, func, select, values
from sqlalchemy.orm import Session

from service.db.models import Drawing, Job, Placement, Revision, Scan
from service.db.robots import RobotReport
from service.domain.acceptance_table import Verdict
from service.domain.ids import first_id_at
from service.domain.lifecycle import JobState, RevisionStatus, RobotState

Bucket = Literal["hour", "day"]
Counted = Literal["jobs", "drawings", "scans", "placements", "revisions", "reports"]

_STEPS = {"hour": timedelta(hours=1), "day": timedelta(days=1)}


@dataclass(frozen=True)
class Point:
    """Hold how many things of one state were made in the hour or day that begins at `at`."""

    at: datetime
    state: str | None
    number: int


@dataclass(frozen=True)
class _Table:
    """Hold of which rows are counted, how their ids begin, and the states that are counted apart."""

    model: Any
    prefix: str
    state: Any = None
    states: tuple[str | None, ...] = (None,)


_TABLES: dict[str, _Table] = {
    "jobs": _Table(Job, "job", Job.state, tuple(JobState)),
    "drawings": _Table(Drawing, "drw"),
    "scans": _Table(Scan, "scn"),
    "placements": _Table(Placement, "plc", Placement.verdict, (None, *get_args(Verdict))),
    "revisions": _Table(Revision, "rev", Revision.status, tuple(RevisionStatus)),
    "reports": _Table(RobotReport, "rep", RobotReport.state, tuple(RobotState)),
}


def series(
    session: Session, what: Counted, *, bucket: Bucket, period: tuple[datetime, datetime]
) -> Sequence[Point]:
    """Return the counts of each hour or day (UTC) in which something was made, oldest first, by state.

    Ids sort by time: each state of an hour or day is a range of the index of state and id, which is counted
    without a look at a row, and nothing outside the period is read.
    """
    table = _TABLES[what]
    begins = _begins(bucket, period)
    ends = [*begins[1:], period[1]]
    ranges = (
        values(column("number", Integer), column("low", String), column("high", String), name="ranges")
        .data(
            [
                (number, first_id_at(table.prefix, max(begin, period[0])), first_id_at(table.prefix, end))
                for number, (begin, end) in enumerate(zip(begins, ends, strict=True))
            ]
        )
        .cte("ranges")
    )
    of_range = and_(table.model.id >= ranges.c.low, table.model.id < ranges.c.high)
    asked = select(func.count()).select_from(table.model).where(of_range).correlate(ranges)
    counts = [
        (asked if table.state is None else asked.where(table.state == state)).scalar_subquery()
        for state in table.states
    ]
    rows = session.execute(select(ranges.c.number, *counts).order_by(ranges.c.number)).all()
    states = sorted(table.states, key=lambda state: state or "")
    return [
        Point(begins[row[0]], state, row[1 + table.states.index(state)])
        for row in rows
        for state in states
        if row[1 + table.states.index(state)]
    ]


def _begins(bucket: Bucket, period: tuple[datetime, datetime]) -> list[datetime]:
    """Return when each hour or day that meets the period begins."""
    since, until = (moment.astimezone(UTC) for moment in period)
    begin = since.replace(minute=0, second=0, microsecond=0)
    if bucket == "day":
        begin = begin.replace(hour=0)
    step = _STEPS[bucket]
    return [begin + number * step for number in range(ceil((until - begin) / step))]
