"""What is going on, in numbers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Generic, TypeVar

from service.db import stats as table
from service.db.models import Revision
from service.db.revisions import latest_revisions
from service.db.series import Bucket, Counted, Point
from service.db.series import series as counted
from service.db.session import Session
from service.domain.access import Actor
from service.domain.errors import InvalidRequest
from service.domain.lifecycle import Role
from service.usecases.kernel import Kernel

_LATEST = 10
_MOST_BUCKETS = 400
_REMEMBERED_FACTOR, _AT_ONCE_S = 20.0, 0.02
T = TypeVar("T")


@dataclass(frozen=True)
class JobFigures:
    """Hold how many jobs are in each state, and for how long the oldest due one has waited [s]."""

    by_state: dict[str, int]
    queue_age_s: float


@dataclass(frozen=True)
class Stats:
    """Hold counts of things, figures of jobs, the latest revisions, and the room on disk [bytes]."""

    totals: dict[str, int]
    jobs: JobFigures
    latest_revisions: Sequence[Revision]
    stored_bytes: int
    free_bytes: int
    is_storage_full: bool


@dataclass(frozen=True)
class WantedSeries:
    """Hold of what, in which steps and over which period counts are asked for."""

    what: Counted
    bucket: Bucket
    period: tuple[datetime, datetime]


class Remembered(Generic[T]):
    """Hold an answer that was dear to find, for twenty times as long as that took: a twentieth of one core.

    What is found at once is found anew each time.
    """

    def __init__(self, find: Callable[[Session], T]) -> None:
        self._find = find
        self._lock = threading.Lock()
        self._held: T | None = None
        self._until = 0.0

    def ask(self, session: Session) -> T:
        """Return the answer; while one thread looks, the others wait for what it finds."""
        with self._lock:
            begun = time.monotonic()
            if self._held is None or begun >= self._until:
                self._held = self._find(session)
                took = time.monotonic() - begun
                self._until = begun + took + (_REMEMBERED_FACTOR * took if took > _AT_ONCE_S else 0.0)
            return self._held


class Figures:
    """Count what is in the tables; one of these serves a whole process."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._totals = Remembered(table.totals)
        self._jobs = Remembered(table.jobs_by_state)
        self._bytes = Remembered(table.blob_bytes)

    def jobs_now(self) -> JobFigures:
        """Return how the jobs stand, in a transaction of its own."""
        with self._kernel.db.reading() as session:
            return self.jobs(session)

    def jobs(self, session: Session) -> JobFigures:
        """Return how the jobs stand."""
        now = self._kernel.now()
        since = table.oldest_due(session, now=now)
        age_s = 0.0 if since is None else max(0.0, (now - since).total_seconds())
        return JobFigures(self._jobs.ask(session), age_s)

    def stats(self, session: Session, actor: Actor) -> Stats:
        """Return the whole service's figures.

        Raises
        ------
        Forbidden
            If `actor` is no admin of all maps.
        """
        actor.require_role(Role.ADMIN)
        actor.require_all_maps()
        return Stats(
            totals=self._totals.ask(session),
            jobs=self.jobs(session),
            latest_revisions=latest_revisions(session, limit=_LATEST),
            stored_bytes=self._bytes.ask(session),
            free_bytes=self._kernel.blobs.free_bytes(),
            is_storage_full=self._kernel.room.refusal() is not None,
        )


def series(session: Session, actor: Actor, wanted: WantedSeries) -> Sequence[Point]:
    """Return how many things of a kind were made in each hour or day of a period, oldest first.

    Raises
    ------
    Forbidden
        If `actor` is no admin of all maps.
    InvalidRequest
        If the period ends before it begins, or has more than 400 hours or days.
    """
    actor.require_role(Role.ADMIN)
    actor.require_all_maps()
    since, until = wanted.period
    buckets = (until - since) / (timedelta(hours=1) if wanted.bucket == "hour" else timedelta(days=1))
    if not 0 < buckets <= _MOST_BUCKETS:
        detail = f"The period has {buckets:.0f} {wanted.bucket}s; it may have 1 to {_MOST_BUCKETS}."
        raise InvalidRequest(detail, errors=[{"parameter": "since", "detail": detail}])
    return counted(session, wanted.what, bucket=wanted.bucket, period=wanted.period)
