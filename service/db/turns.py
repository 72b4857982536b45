"""Whose turn it is: the queue is fair over keys, and over each key's maps, whatever each has waiting."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

from sqlalchemy import ColumnElement, and_, exists, func, or_, select
from sqlalchemy.orm import Session

from service.db.models import Job
from service.domain.lifecycle import JobKind, JobState

_IS_READING = Job.kind.in_((JobKind.READ_DRAWING.value, JobKind.READ_SCAN.value))


_NEVER = datetime.min.replace(tzinfo=UTC)


class _Served(NamedTuple):
    """Hold how many jobs run for somebody, and when the last one was begun; the least is served first."""

    running: int = 0
    last_at: datetime = _NEVER


@dataclass(frozen=True)
class _Waiting:
    """Hold what waits for one key on one map: its readings, or all the rest, and since when."""

    key_id: str | None
    map_id: str
    is_reading: bool
    since: datetime

    def jobs(self, now: datetime) -> ColumnElement[bool]:
        """Return which jobs these are."""
        kind = _IS_READING if self.is_reading else ~_IS_READING
        return and_(due(now), Job.key_id.is_not_distinct_from(self.key_id), Job.map_id == self.map_id, kind)


def due(now: datetime) -> ColumnElement[bool]:
    """Return which jobs are due: queued and past their back-off, or under a lease that has expired."""
    return or_(
        and_(Job.state == JobState.QUEUED.value, Job.run_after <= now),
        and_(Job.state == JobState.RUNNING.value, Job.lease_until < now),
    )


def is_any_due(session: Session, *, now: datetime) -> bool:
    """Return whether some job is due; a cheap look that takes no lock."""
    return bool(session.scalar(select(exists().where(due(now)))))


def in_turn(session: Session, *, now: datetime) -> Iterator[Job]:
    """Give the due job whose turn it is, locked; then the next one, where that cannot be had or is ended.

    First comes the key of which the fewest jobs run, of several the one that was served longest ago since
    somebody waits; then of its maps the one that stands so. Between equals a build or a placement comes
    before the reading of a file, and the oldest before the rest. So whoever asks waits for one job of each
    other key at most, and not for what they have in the queue; and a key holds all workers only while
    nobody else waits, else no more of them than its share.

    Notes
    -----
    What was done while nobody waited is forgotten: a key that has worked alone owes nothing. The product's
    own jobs (webhooks, deltas that it foresees) take turns as one key does. A job that another worker has
    just locked is passed over (PostgreSQL; on SQLite one claims at a time).
    """
    while True:
        job = next(_candidates(session, now), None)
        if job is None:
            return
        yield job


def _candidates(session: Session, now: datetime) -> Iterator[Job]:
    for waiting in _turns(session, now):
        wanted = select(Job).where(waiting.jobs(now)).order_by(Job.run_after, Job.id).limit(1)
        job = session.scalars(wanted.with_for_update(skip_locked=True)).one_or_none()
        if job is not None:
            yield job


def _turns(session: Session, now: datetime) -> list[_Waiting]:
    """Return who waits, in the order in which they are to be served."""
    grouped = (Job.key_id, Job.map_id, _IS_READING)
    rows = session.execute(select(*grouped, func.min(Job.run_after)).where(due(now)).group_by(*grouped))
    waiting = [_Waiting(key_id, map_id, bool(reading), since) for key_id, map_id, reading, since in rows]
    if len(waiting) < 2:
        return waiting
    of_key, of_map = _served(session, now=now, since=min(one.since for one in waiting))
    return sorted(
        waiting,
        key=lambda one: (of_key[one.key_id], of_map[one.key_id, one.map_id], one.is_reading, one.since),
    )


def _served(
    session: Session, *, now: datetime, since: datetime
) -> tuple[Mapping[str | None, _Served], Mapping[tuple[str | None, str], _Served]]:
    """Return how each key, and each map of each key, is served now and was since then."""
    runs = and_(Job.state == JobState.RUNNING.value, Job.lease_until >= now)
    asked = select(Job.key_id, Job.map_id, func.count().filter(runs), func.max(Job.started_at))
    rows = session.execute(asked.where(or_(Job.started_at >= since, runs)).group_by(Job.key_id, Job.map_id))
    of_key: defaultdict[str | None, _Served] = defaultdict(_Served)
    of_map: defaultdict[tuple[str | None, str], _Served] = defaultdict(_Served)
    for key_id, map_id, running, begun_at in rows:
        last_at, before = begun_at or _NEVER, of_key[key_id]
        of_map[key_id, map_id] = _Served(running, last_at)
        of_key[key_id] = _Served(before.running + running, max(before.last_at, last_at))
    return of_key, of_map
