"""How a worker learns that there is work: it polls on SQLite; procrastinate delivers on PostgreSQL."""

from __future__ import annotations

import asyncio
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

import procrastinate
import structlog
from sqlalchemy import text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from service.db.jobs import QUEUE, TASK, any_due, deliver, overdue
from service.db.session import Database
from service.domain.errors import Unavailable
from service.domain.ids import Clock

_LOOK_FOR_LOST_S = 2.0
_START_AGAIN_S = 1.0
_STOP_S = 5.0
_FETCH_EVERY_S = 1.0
_HEARTBEAT_S = 5.0
_STALLED_S = 20.0

log = structlog.get_logger(__name__)


class Delivery(Protocol):
    """Say that a job may be due; `service.db.jobs.claim` decides which one, and who gets it."""

    def next(self, *, timeout_s: float) -> bool:
        """Return whether there may be a job to claim, waiting up to `timeout_s` for one."""

    def done(self) -> None:
        """Say that what was said last needs no more of this worker."""

    def close(self) -> None:
        """Stop delivering."""


class QueuePolling:
    """Look into the `jobs` table again and again: for one machine.

    Parameters
    ----------
    database : Database
        Holds the jobs.
    now : Clock
        Tells the present.
    poll_s : float
        Seconds between two looks.
    """

    def __init__(self, database: Database, *, now: Clock, poll_s: float) -> None:
        self._database = database
        self._now = now
        self._poll_s = poll_s

    def next(self, *, timeout_s: float) -> bool:
        """Return whether a job is due, waiting up to `timeout_s` for one."""
        until = time.monotonic() + timeout_s
        while True:
            with self._database.reading() as session:
                is_due = any_due(session, now=self._now())
            if is_due or time.monotonic() >= until:
                return is_due
            time.sleep(self._poll_s)

    def done(self) -> None:
        """Do nothing: a poll holds nothing."""

    def close(self) -> None:
        """Do nothing: a poll holds nothing."""


class Delivered:
    """Let a procrastinate worker, in a thread of its own, fetch one delivery at a time.

    A delivery is taken for a call to claim some job, since the order of deliveries is that of asking and
    not that of turns: there are as many as jobs. It is acknowledged when the job is settled. Lost workers'
    jobs are looked for every two seconds by every worker: where more are due than deliveries wait, new
    ones are made.

    Parameters
    ----------
    database : Database
        Holds the jobs; on PostgreSQL.
    now : Clock
        Tells the present.
    name : str
        The worker's name.
    """

    def __init__(self, database: Database, *, now: Clock, name: str) -> None:
        self._database = database
        self._now = now
        self._name = name
        self._inbox: queue.Queue[Callable[[], None]] = queue.Queue()
        self._acknowledge: Callable[[], None] | None = None
        self._closing = threading.Event()
        self._stop: Callable[[], Any] | None = None
        self._thread = threading.Thread(target=self._deliver, name="delivery", daemon=True)
        self._thread.start()

    def next(self, *, timeout_s: float) -> bool:
        """Return whether a delivery has come, waiting up to `timeout_s` for one."""
        try:
            self._acknowledge = self._inbox.get(timeout=timeout_s)
        except queue.Empty:
            return False
        return True

    def done(self) -> None:
        """Acknowledge the delivery."""
        if self._acknowledge is not None:
            self._acknowledge()
            self._acknowledge = None

    def close(self) -> None:
        """Acknowledge what was delivered, and stop. A job that this worker did not do is delivered anew."""
        self._closing.set()
        self.done()
        if self._stop is not None:
            self._stop()
        with suppress(queue.Empty):
            while True:
                self._inbox.get_nowait()()
        self._thread.join(_STOP_S)

    def _deliver(self) -> None:
        while not self._closing.is_set():
            try:
                asyncio.run(self._serve())
            except Exception:
                log.exception("the delivery of jobs broke off and starts again")
            self._closing.wait(_START_AGAIN_S)

    async def _serve(self) -> None:
        url = self._database.engine.url.set(drivername="postgresql")
        connector = procrastinate.PsycopgConnector(
            conninfo=url.render_as_string(hide_password=False), min_size=1, max_size=4
        )
        app = procrastinate.App(connector=connector)
        loop = asyncio.get_running_loop()

        @app.task(name=TASK, queue=QUEUE)
        async def run_job(job_id: str) -> None:  # noqa: ARG001 - any job may be meant
            settled = asyncio.Event()

            def settle() -> None:
                with suppress(RuntimeError):
                    loop.call_soon_threadsafe(settled.set)

            self._inbox.put(settle)
            await settled.wait()

        async with app.open_async():
            looking = asyncio.create_task(self._look_for_lost())
            working = asyncio.create_task(
                app.run_worker_async(
                    queues=[QUEUE],
                    name=self._name,
                    concurrency=1,
                    delete_jobs="always",
                    install_signal_handlers=False,
                    fetch_job_polling_interval=_FETCH_EVERY_S,
                    update_heartbeat_interval=_HEARTBEAT_S,
                    stalled_worker_timeout=_STALLED_S,
                    shutdown_graceful_timeout=_STOP_S,
                )
            )
            self._stop = lambda: loop.call_soon_threadsafe(working.cancel)
            try:
                with suppress(asyncio.CancelledError):
                    await working
            finally:
                self._stop = None
                looking.cancel()

    async def _look_for_lost(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_FOR_LOST_S)
            try:
                await asyncio.to_thread(self._redeliver)
            except (Unavailable, SQLAlchemyError) as error:
                log.warning("lost jobs could not be looked for; soon again", cause=repr(error))

    def _redeliver(self) -> None:
        with self._database.writing("redeliver-jobs") as session:
            for job_id in redeliver_lost(session, now=self._now):
                log.warning("a job has no delivery and is delivered anew", job=job_id)


def redeliver_lost(session: Session, *, now: Clock) -> list[str]:
    """Return jobs that were due beyond those that deliveries wait for; each has one of its own now.

    Deliveries that a dead procrastinate worker holds are dropped.
    """
    session.execute(text("SELECT procrastinate_prune_stalled_workers_v1(:seconds)"), {"seconds": _STALLED_S})
    session.execute(
        text(
            "DELETE FROM procrastinate_jobs WHERE status = 'doing' AND worker_id IS NULL AND queue_name = :q"
        ),
        {"q": QUEUE},
    )
    waiting = session.scalars(
        text(
            "SELECT args->>'job_id' FROM procrastinate_jobs WHERE status = 'todo' AND queue_name = :q"
            " AND (scheduled_at IS NULL OR scheduled_at <= now())"
        ),
        {"q": QUEUE},
    ).all()
    missed = overdue(session, now=now())
    lost = [job_id for job_id in missed if job_id not in waiting][: max(0, len(missed) - len(waiting))]
    for job_id in lost:
        deliver(session, job_id)
    return lost


def open_delivery(database: Database, *, now: Clock, poll_s: float, name: str) -> Delivery:
    """Return the delivery that fits the database."""
    if database.is_sqlite:
        return QueuePolling(database, now=now, poll_s=poll_s)
    return Delivered(database, now=now, name=name)
