"""The worker's parent process: it holds the lease of one job at a time and lets a child do the work.

It loads no job code, so no job can take it down or keep it from its beat.
"""

from __future__ import annotations

import math
import shutil
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import structlog

from service.db import jobs, waiting
from service.db.delivery import Delivery
from service.db.jobs import Attempt, LeaseLost
from service.db.session import Session
from service.domain.errors import DatabaseBusy, DomainError, StorageFull, Unavailable
from service.domain.job_limits import JobLimits, Limits, Usage
from service.domain.lifecycle import MOST_FULL_TRIES, room_wait_s
from service.domain.reading_cost import ReadingLimits
from service.storage.room import Space, Spare, found_full, full_disk_refused
from service.usecases.kernel import Kernel
from worker.figures import Figures
from worker.process import WarmChild, why_it_died

_READY_TIMEOUT_S = 120.0
_STILLBORN_MAX = 5
_IDLE_S = 0.5
_LISTEN_S = 0.2
_PROGRESS_EVERY_S = 0.25
_STOP_GRACE_S = 3.0
_SWEEP_EVERY_S = 60.0
_ROOM_IS_SURE_S = 2.0

log = structlog.get_logger(__name__)


class NoChild(Exception):
    """Children end before they are ready, again and again: this worker cannot work."""


@dataclass(frozen=True)
class Terms:
    """Hold how a worker works: its name, its folder for jobs, its lease, its beat, and a job's limits.

    `room_wait_s` is the least time until a job that found no room is tried again.
    """

    name: str
    folder: Path
    lease_s: float
    beat_s: float
    limits: JobLimits
    room_wait_s: float


@dataclass
class _Watch:
    """Hold what the parent knows of the running attempt; times are monotonic seconds.

    `space` is how the scarcest disk stood when it began.
    """

    attempt: Attempt
    child: WarmChild
    limits: Limits
    space: Space | None
    started_at: float
    beaten_at: float
    ending: Callable[[Session], None] | None = None
    told: dict[str, Any] = field(default_factory=dict)
    last_word: dict[str, Any] | None = None
    is_shown: bool = False
    is_recorded: bool = False
    is_broken_off: bool = False

    def outcome(self) -> str:
        """Return how the attempt ended, in a word."""
        if self.is_broken_off:
            return "broken-off"
        if self.last_word is None:
            return "died"
        return "failed" if self.last_word["message"] == "failed" else "done"

    def pause_s(self, beat_s: float) -> float:
        """Return the seconds between two beats: none at the job's first word, few while it speaks."""
        if self.is_recorded:
            return math.inf
        if not self.told:
            return beat_s
        return _PROGRESS_EVERY_S if self.is_shown else 0.0

    @property
    def used(self) -> Usage:
        """Return the most that the job was seen to take."""
        return replace(self.child.used, wall_s=time.monotonic() - self.started_at)


class Runner:
    """Claim, hand over, beat, relay, limit and settle, until told to stop.

    Parameters
    ----------
    kernel : Kernel
        The database, the clock and the source of tokens.
    delivery : Delivery
        Tells that a job may be due.
    terms : Terms
        How to work.
    figures : Figures
        Where attempts are counted.
    """

    def __init__(self, kernel: Kernel, delivery: Delivery, *, terms: Terms, figures: Figures) -> None:
        self._kernel = kernel
        self._delivery = delivery
        self._terms = terms
        self._figures = figures
        self._stopping = threading.Event()
        self._stop_by = float("inf")
        self._child: WarmChild | None = None
        self._is_called = False
        self._swept_at = float("-inf")
        self._full_at = float("-inf")
        self._spare = Spare(terms.folder)

    def stop(self, _signal: int = signal.SIGTERM, _frame: object = None) -> None:
        """End soon: a running job gets a few seconds, then it is given back for another worker."""
        self._stop_by = time.monotonic() + _STOP_GRACE_S
        self._stopping.set()

    def run(self) -> None:
        """Work until `stop` is called.

        Raises
        ------
        NoChild
            If no child process gets ready.
        """
        self._terms.folder.mkdir(parents=True, exist_ok=True)
        try:
            while not self._stopping.is_set():
                child = self._prepare()
                if child is not None:
                    self._turn(child)
        finally:
            if self._child is not None:
                self._child.end()
            self._spare.let_go()
            self._delivery.close()

    def _turn(self, child: WarmChild) -> None:
        """Do one job if there is one; it is claimed only while the child is there to do it."""
        try:
            self._sweep()
            if not self._has_room():
                self._stopping.wait(_IDLE_S)
                return
            self._is_called = self._is_called or self._delivery.next(timeout_s=_IDLE_S)
            if not self._is_called or not child.wait_ready(timeout_s=0.0):
                return
            attempt, self._is_called = self._claim(), False
            if attempt is not None:
                self._work(attempt, child)
            self._delivery.done()
        except Unavailable as refusal:
            log.warning(
                "the database did not answer", problem=refusal.slug(), cause=refusal.members.get("cause")
            )
            self._stopping.wait(1.0)

    def _has_room(self) -> bool:
        """Return whether a job may be begun; while none may, let those that are due tell what they wait for.

        When room comes back, whoever holds a job writes first how its try ended: it could not before.
        """
        full = self._kernel.room.refusal()
        if full is None:
            self._spare.hold()
            return time.monotonic() - self._full_at > _ROOM_IS_SURE_S
        self._full_at = time.monotonic()
        with self._kernel.db.reading() as session:
            untold = waiting.due_untold(session, now=self._kernel.now())
        if untold:
            log.warning("the disk is full: jobs wait for room", jobs=len(untold), **full.members)
            if self._kernel.room.is_used_up():
                self._spare.let_go()
            with self._kernel.db.writing("tell-waiting-jobs") as session:
                waiting.tell_why_waiting(session, untold, problem=full.problem())
        return False

    def _prepare(self) -> WarmChild | None:
        """Return the child whose imports are done; None when it is time to stop."""
        for _ in range(_STILLBORN_MAX):
            if self._child is None or self._child.has_ended:
                self._child = WarmChild()
            until = time.monotonic() + _READY_TIMEOUT_S
            while time.monotonic() < until and not self._child.has_ended:
                if self._stopping.is_set():
                    return None
                if self._child.wait_ready(timeout_s=_LISTEN_S):
                    return self._child
            self._child.end()
            log.warning("a child ended before it was ready", how=self._child.how_it_ended())
            self._stopping.wait(1.0)
        raise NoChild

    def _claim(self) -> Attempt | None:
        with self._kernel.db.writing("claim-job") as session:
            return jobs.claim(
                session,
                worker=self._terms.name,
                token=self._kernel.new_id("att"),
                lease_s=self._terms.lease_s,
                now=self._kernel.now(),
            )

    def _work(self, attempt: Attempt, child: WarmChild) -> None:
        """Let the child do the job, watch it, and settle how it ended."""
        bound = log.bind(job=attempt.job_id, kind=str(attempt.kind), attempt=attempt.attempt)
        bound.info("job started")
        workdir = self._terms.folder / attempt.token
        now = time.monotonic()
        space = self._kernel.room.scarcest()
        watch = _Watch(attempt, child, self._terms.limits, space, started_at=now, beaten_at=now)
        self._figures.begin()
        try:
            with full_disk_refused():
                workdir.mkdir()
            child.hand_over(attempt, workdir=workdir, limits=self._terms.limits)
            while child.is_working:
                self._listen(watch)
                self._guard(watch)
            self._judge(watch)
        except StorageFull as full:
            watch.ending = self._waiting(watch, full.problem())
        finally:
            if child.is_working:
                child.end()
            shutil.rmtree(workdir, ignore_errors=True)
            took = {"seconds": time.monotonic() - watch.started_at, "cpu_s": child.used.cpu_s}
            self._figures.end(str(attempt.kind), watch.outcome(), **took, peak_bytes=child.peak_bytes)
        self._settle(watch)
        told = {name: round(value, 3) for name, value in took.items()}
        bound.info("job ended", **told, peak_mib=child.peak_bytes >> 20)

    def _listen(self, watch: _Watch) -> None:
        """Take what the job says."""
        for message in watch.child.listen(timeout_s=_LISTEN_S):
            if message["message"] == "progress":
                watch.told = {"stage": message["stage"], "fraction": message["fraction"]}
                if "reading" in message:
                    watch.limits = ReadingLimits.from_json(message["reading"])
            else:
                watch.last_word = message

    def _judge(self, watch: _Watch) -> None:
        """Decide what becomes of a job that ended by itself; its end without a word is a death."""
        if watch.is_broken_off:
            return
        if watch.last_word is None:
            watch.ending = self._death(watch)
        elif watch.last_word["message"] == "failed":
            watch.ending = self._ending(watch, watch.last_word)

    def _guard(self, watch: _Watch) -> None:
        """Beat when it is time; end what is cancelled, lost, over a limit, or to be given back."""
        if not watch.child.is_working or watch.last_word is not None:
            return
        now, attempt = time.monotonic(), watch.attempt
        passed = watch.limits.passed(replace(watch.child.look(), wall_s=now - watch.started_at))
        if passed is not None:
            self._break_off(watch, self._failing(attempt, watch.limits.refusal(passed, watch.used)))
        elif now > self._stop_by:
            self._break_off(watch, lambda s: waiting.give_back(s, attempt, now=self._kernel.now()))
        elif now - watch.beaten_at > watch.pause_s(self._terms.beat_s):
            self._beat(watch)

    def _beat(self, watch: _Watch) -> None:
        attempt = watch.attempt
        try:
            with self._kernel.db.writing("beat-job") as session:
                cancelled = jobs.beat(
                    session, attempt, lease_s=self._terms.lease_s, now=self._kernel.now(), **watch.told
                )
        except LeaseLost:
            self._yield(watch)
            return
        except Unavailable as refusal:
            log.warning("a beat failed", job=attempt.job_id, problem=refusal.slug())
            return
        watch.is_shown |= bool(watch.told)
        watch.beaten_at, watch.told = time.monotonic(), {}
        if cancelled:
            self._break_off(watch, lambda s: jobs.finish_cancelled(s, attempt, now=self._kernel.now()))

    def _yield(self, watch: _Watch) -> None:
        """Let a job that has recorded its result come to its end; stop one that another worker took over."""
        with self._kernel.db.reading() as session:
            watch.is_recorded = jobs.has_succeeded(session, watch.attempt)
        if not watch.is_recorded:
            log.warning("the job was taken over or ended elsewhere", job=watch.attempt.job_id)
            self._break_off(watch, None)

    def _break_off(self, watch: _Watch, ending: Callable[[Session], None] | None) -> None:
        """Kill the child, then judge: what it has committed by then stands."""
        watch.child.end_job()
        watch.is_broken_off, watch.ending = True, ending

    def _ending(self, watch: _Watch, message: dict[str, Any]) -> Callable[[Session], None] | None:
        """Return what becomes of a job whose child says that it failed."""
        attempt = watch.attempt
        if message["why"] == "lease-lost":
            return None
        if message["why"] == "full":
            return self._waiting(watch, message["problem"])
        if message["why"] == "unavailable":
            return lambda s: self._try_again(s, attempt, message["problem"])
        if message["why"] == "memory":
            return self._failing(attempt, watch.limits.refusal("memory", watch.used))
        if message["why"] == "defect":
            return self._failing(attempt, jobs.crashed(attempts=attempt.attempt, last=message["last"]))
        return lambda s: jobs.finish_failed(s, attempt, problem=message["problem"], now=self._kernel.now())

    def _death(self, watch: _Watch) -> Callable[[Session], None]:
        """Return what becomes of a job whose child ended without a word."""
        attempt, how = watch.attempt, watch.child.how_it_ended()
        log.warning("a child died", job=attempt.job_id, attempt=attempt.attempt, how=how)
        if self._kernel.room.is_used_up():  # SIGBUS, where a file is mapped
            return self._waiting(watch, found_full().problem())
        refusal = why_it_died(watch.child, watch.limits, watch.used)
        if refusal is not None:
            return self._failing(attempt, refusal)
        problem = jobs.crashed(attempts=attempt.attempt, last=how).problem()
        return lambda s: self._try_again(s, attempt, problem)

    def _waiting(self, watch: _Watch, problem: dict[str, Any]) -> Callable[[Session], None]:
        """Return that a job found no room: it waits. If it began with room, it does so a few times."""
        attempt, space, now = watch.attempt, watch.space, self._kernel.now
        wait_s = room_wait_s(time.monotonic() - watch.started_at, least_s=self._terms.room_wait_s)
        waits: dict[str, Any] = {"problem": problem, "wait_s": wait_s}
        if space is None or space.is_full:
            log.warning("the job found no room on the disk", job=attempt.job_id)
            return lambda s: waiting.give_back(s, attempt, **waits, now=now())
        log.warning("the job filled the disk", job=attempt.job_id, free_bytes=space.free_bytes)
        last = space.did_not_do(MOST_FULL_TRIES).problem()

        def wait(session: Session) -> None:
            waiting.wait_for_room(session, attempt, last=last, **waits, now=now())

        return wait

    def _try_again(self, session: Session, attempt: Attempt, problem: dict[str, Any]) -> None:
        jobs.try_again(session, attempt, problem=problem, now=self._kernel.now())

    def _failing(self, attempt: Attempt, refusal: DomainError) -> Callable[[Session], None]:
        return lambda s: jobs.finish_failed(s, attempt, problem=refusal.problem(), now=self._kernel.now())

    def _settle(self, watch: _Watch) -> None:
        """Write how the attempt ended; where the result is recorded already, or the lease is lost, nothing.

        A database that does not answer is asked again until the lease is over: then another attempt
        takes over anyway. One whose disk is full is asked until there is room: nobody can take over before.
        """
        while watch.ending is not None:
            try:
                with self._kernel.db.writing("end-job") as session:
                    watch.ending(session)
            except LeaseLost:
                pass
            except StorageFull:
                self._spare.let_go()
                if not self._stopping.wait(_LISTEN_S):
                    continue
            except DatabaseBusy:
                if time.monotonic() - watch.beaten_at < 2 * self._terms.lease_s:
                    time.sleep(1.0)
                    continue
            return

    def _sweep(self) -> None:
        """Remove folders of attempts that are over: their workers died before they could."""
        if time.monotonic() - self._swept_at < _SWEEP_EVERY_S:
            return
        self._swept_at = time.monotonic()
        folders = [f for f in self._terms.folder.iterdir() if f.is_dir()]
        with self._kernel.db.reading() as session:
            alive = jobs.running_tokens(session)
        for folder in folders:
            if folder.name not in alive:
                shutil.rmtree(folder, ignore_errors=True)
