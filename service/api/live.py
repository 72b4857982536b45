"""Event streams: one look at the database a process, fanned out in the event loop to all who listen.

Nobody who listens costs a thread or a query of their own. A listener is told bytes that were encoded once,
and between them a comment now and then, so that proxies keep the connection.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated

import anyio
import structlog
from fastapi import Depends, Request
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from service.api.schemas.jobs import JobOut
from service.db.changes import open_changes
from service.db.models import Job
from service.db.session import SQLAlchemyError
from service.domain.access import Actor
from service.domain.errors import DomainError, TooManyStreams
from service.domain.lifecycle import JobState
from service.usecases.fleet_events import FleetEvent, News
from service.usecases.kernel import Kernel
from service.usecases.live import Seen, look

LOOK_AT_LEAST_EVERY_S = 1.0
TRUSTED_S = 4.0
"""Seconds for which a key that was valid counts as such: no stream outlives a look that old."""

KEEP_ALIVE_S = 15.0
QUEUE = 1_000
PAUSE_S = 0.1
TICK_S = 0.25
_TURNS = int(KEEP_ALIVE_S / TICK_S)
_AT_ONCE = 50
_LAST_WORDS_S = 0.5
_RETRY_AFTER_S = 10

RETRY = b"retry: 1000\n\n"

log = structlog.get_logger(__name__)


class Message:
    """Hold what is sent to many listeners: encoded when the first of them is sent it, and only once.

    Parameters
    ----------
    mark : str
        Id of the event; empty for a comment.
    encode : callable
        Return the lines of the event.
    is_last : bool
        Whether the stream ends after it.
    """

    def __init__(self, mark: str, encode: Callable[[], str], *, is_last: bool = False) -> None:
        self.mark = mark
        self.is_last = is_last
        self._encode = encode

    @cached_property
    def frame(self) -> bytes:
        """Return the bytes that are sent."""
        return f"{self._encode()}\n\n".encode()


_KEEP_ALIVE = Message("", lambda: ": still here")


@dataclass(frozen=True)
class Topic:
    """Hold what is listened to: a job, or the fleet's events of one map (None: all that the key covers).

    `base_url` completes the addresses that a job's problem holds.
    """

    job_id: str | None = None
    map_id: str | None = None
    base_url: str = ""


class Listener:
    """One open stream: what is still to be sent to it. Lives in the event loop alone.

    A client that reads too slowly for `QUEUE` messages is cut off; it comes again with `Last-Event-ID`.

    Parameters
    ----------
    actor : Actor
        Who listens.
    topic : Topic
        To what.
    """

    def __init__(self, actor: Actor, topic: Topic) -> None:
        self.actor = actor
        self.topic = topic
        self.joined_at = time.monotonic()
        self.scope = anyio.CancelScope()
        self._messages: deque[Message] = deque()
        self._wake = asyncio.Event()
        self._is_cut = False

    def hears(self, event: FleetEvent) -> bool:
        """Return whether an event is of this stream."""
        if self.topic.job_id is not None or not self.actor.covers(event.map_id):
            return False
        return self.topic.map_id in {None, event.map_id}

    def put(self, message: Message) -> None:
        """Have a message sent."""
        if len(self._messages) >= QUEUE:
            self.cut()
        self._messages.append(message)
        self._wake.set()

    def cut(self) -> None:
        """End the stream, with nothing of what waits; a client that reads nothing is not waited for."""
        if not self._is_cut:
            self._is_cut = True
            self._messages.clear()
            self._wake.set()
            asyncio.get_running_loop().call_later(_LAST_WORDS_S, self.scope.cancel)

    async def messages(self) -> AsyncIterator[Message]:
        """Give each message as it comes, until the stream is cut."""
        while not self._is_cut:
            while self._messages and not self._is_cut:
                yield self._messages.popleft()
            if not self._messages:
                self._wake.clear()
                await self._wake.wait()


class Broadcast:
    """Look for all listeners of this process, and tell each what is theirs.

    Parameters
    ----------
    kernel : Kernel
        Where rows are read; its database is this object's own, so that no request stands in the way.
    max_streams_per_key : int
        Most streams that one key may have open.
    """

    def __init__(self, kernel: Kernel, *, max_streams_per_key: int) -> None:
        self._kernel = kernel
        self._max_streams = max_streams_per_key
        self._changes = open_changes(kernel.db)
        self._turns: list[set[Listener]] = [set() for _ in range(_TURNS)]
        self._next_turn = 0
        self._open: Counter[str] = Counter()
        self._jobs: dict[str, int] = {}
        self._looked_at = float("-inf")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped = False

    @contextmanager
    def joined(self, actor: Actor, topic: Topic) -> Iterator[Listener]:
        """Give a new listener, who is told what happens from here on; an error within takes it off again.

        Raises
        ------
        TooManyStreams
            If the key has as many streams as it may have.
        """
        if self._open[actor.key_id] >= self._max_streams:
            raise TooManyStreams(
                f"This key has {self._max_streams} event streams open, as many as one key may have; close "
                "one, or give each listener a key of its own.",
                max_streams=self._max_streams,
                retry_after_s=_RETRY_AFTER_S,
            )
        listener = Listener(actor, topic)
        self._open[actor.key_id] += 1
        min(self._turns, key=len).add(listener)
        if self._stopped:
            listener.cut()
        try:
            yield listener
        except BaseException:
            self.leave(listener)
            raise

    def leave(self, listener: Listener) -> None:
        """Forget a listener; twice is once."""
        for turn in self._turns:
            if listener in turn:
                turn.remove(listener)
                self._open.subtract([listener.actor.key_id])
                self._open += Counter()  # whoever has none left is forgotten

    def stop(self) -> None:
        """End every stream, for good; may be called from a signal's handler."""
        self._stopped = True
        self._changes.close()
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._cut_all)

    async def run(self) -> None:
        """Look, tell and keep alive until cancelled."""
        self._loop = asyncio.get_running_loop()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._look_for_ever())
                tasks.create_task(self._keep_alive())
        finally:
            self._cut_all()

    def _listeners(self) -> Iterator[Listener]:
        for turn in self._turns:
            yield from tuple(turn)

    def _cut_all(self) -> None:
        for listener in self._listeners():
            listener.cut()

    async def _look_for_ever(self) -> None:
        """Look after each write, and now and then without one, in a thread that does nothing else."""
        loop, pool, news = asyncio.get_running_loop(), ThreadPoolExecutor(1, "live"), News()
        waiting = partial(self._changes.wait, timeout_s=LOOK_AT_LEAST_EVERY_S)
        try:
            while not self._stopped:
                await loop.run_in_executor(pool, waiting)
                begun, key_ids, jobs = time.monotonic(), frozenset(self._open), self._wanted()
                if not key_ids:
                    news = News()
                    continue
                looking = partial(look, self._kernel, news, key_ids=key_ids, jobs=jobs)
                try:
                    seen = await loop.run_in_executor(pool, looking)
                except (DomainError, SQLAlchemyError) as error:
                    log.warning("listeners could not be looked for; soon again", cause=repr(error))
                except Exception:  # a defect ends no stream at once: whoever is not looked for is cut in time
                    log.exception("listeners could not be looked for; soon again")
                else:
                    self._looked_at = begun
                    await self._tell(seen, key_ids)
                await asyncio.sleep(PAUSE_S)
        finally:
            pool.shutdown(wait=False)

    def _wanted(self) -> Mapping[str, int]:
        """Return the jobs that somebody listens to, each with its counter as it was told last."""
        wanted = {one.topic.job_id for one in self._listeners() if one.topic.job_id is not None}
        self._jobs = {job_id: self._jobs.get(job_id, -1) for job_id in wanted}
        return dict(self._jobs)

    async def _tell(self, seen: Seen, key_ids: frozenset[str]) -> None:
        ended = key_ids - set(seen.valid_keys)
        for listener in self._listeners():
            if listener.actor.key_id in ended:
                listener.cut()
        for job in seen.jobs:
            self._jobs[job.id] = job.changed
            with _alone(job.id):
                await self._tell_job(job)
        for event in seen.events:
            with _alone(event.id):
                message = event_message(event)
                await _fan_out((one, message) for one in self._listeners() if one.hears(event))

    async def _tell_job(self, job: Job) -> None:
        theirs = [one for one in self._listeners() if one.topic.job_id == job.id]
        shown = {url: job_message(job, base_url=url) for url in {one.topic.base_url for one in theirs}}
        await _fan_out((one, shown[one.topic.base_url]) for one in theirs)

    async def _keep_alive(self) -> None:
        """Send every listener a comment now and then, each tick to a few of them; end who is out of trust."""
        while True:
            await asyncio.sleep(TICK_S)
            self._next_turn = (self._next_turn + 1) % _TURNS
            for listener in tuple(self._turns[self._next_turn]):
                listener.put(_KEEP_ALIVE)
            least = time.monotonic() - TRUSTED_S
            if self._looked_at < least:
                for listener in self._listeners():
                    if listener.joined_at < least:
                        listener.cut()


@contextmanager
def _alone(thing_id: str) -> Iterator[None]:
    """Let a thing that cannot be told keep nothing else from being told."""
    try:
        yield
    except Exception:  # a row of a later version, say
        log.exception("listeners could not be told", id=thing_id)


async def _fan_out(told: Iterable[tuple[Listener, Message]]) -> None:
    """Tell a few listeners at once, and let requests be answered in between."""
    for number, (listener, message) in enumerate(told, start=1):
        listener.put(message)
        if number % _AT_ONCE == 0:
            await asyncio.sleep(0)


def event_message(event: FleetEvent) -> Message:
    """Return an event of the fleet as it is sent."""

    def encode() -> str:
        told = {"id": event.id, "map_id": event.map_id, "at": event.at.isoformat(), **event.told}
        return f"event: {event.kind}\nid: {event.id}\ndata: {json.dumps(told)}"

    return Message(event.id, encode)


def job_message(job: Job, *, base_url: str) -> Message:
    """Return a job's state as it is sent; the counter of its changes is the id."""

    def encode() -> str:
        shown = JobOut.of(job, base_url=base_url).model_dump_json()
        return f"event: job\nid: {job.changed}\ndata: {shown}"

    return Message(str(job.changed), encode, is_last=JobState(job.state).is_final)


class EventStream(StreamingResponse):
    """Answer with the frames of a listener, who is forgotten when the answer ends, however it ends.

    Parameters
    ----------
    broadcast : Broadcast
        Where the listener has joined.
    listener : Listener
        Whose stream it is.
    frames : async iterator of bytes
        What is sent.
    """

    def __init__(self, broadcast: Broadcast, listener: Listener, frames: AsyncIterator[bytes]) -> None:
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        super().__init__(frames, media_type="text/event-stream", headers=headers)
        self._broadcast = broadcast
        self._listener = listener

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        try:
            with self._listener.scope:
                await super().__call__(scope, receive, send)
        finally:
            self._broadcast.leave(self._listener)


def _broadcast(request: Request) -> Broadcast:
    broadcast: Broadcast = request.app.state.broadcast
    return broadcast


BroadcastDep = Annotated[Broadcast, Depends(_broadcast)]
"""Where listeners join."""
