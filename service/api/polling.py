"""Answers to robots that poll, from memory: at most half a second old, and never older than a local write."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Generic, TypeVar

from starlette.concurrency import run_in_threadpool

from service.domain.access import Actor
from service.usecases.kernel import Kernel
from service.usecases.keys import secret_digest
from service.usecases.polling import Follower, Place, Polled, place_of, still_valid, tag_at, tags
from service.usecases.publish import pointer_tag

K = TypeVar("K")
V = TypeVar("V")

MAX_AGE_S = 0.5
CAPACITY = 10_000
_FORGOTTEN_AFTER_S = 60.0
_BATCH = 1_000


@dataclass(frozen=True)
class _Holder:
    """Hold who has a key, until when it is valid, and what its robot follows."""

    actor: Actor
    expires_at: datetime | None
    follower: Follower | None


@dataclass
class _Entry(Generic[V]):
    value: V
    asked_at: float


@dataclass
class _Snapshot:
    """Hold what was read at one time: `writes` is what the database had counted before."""

    read_at: float = float("-inf")
    writes: int = -1
    holders: dict[str, _Entry[_Holder]] = field(default_factory=dict)
    tags: dict[Place, _Entry[str]] = field(default_factory=dict)


class Polling:
    """Remember whose key is valid and where channels point, for the time being.

    All entries are read anew together, in a few statements, when they are too old and somebody asks: a
    thousand robots cost no more than one look at the database each half second. What another process
    changes is seen within `max_age_s`, what this one changes at once.

    Parameters
    ----------
    kernel : Kernel
        Where rows are read.
    max_age_s : float
        Oldest answer that is given.
    capacity : int
        Most keys, and most channels, that are remembered.
    clock : callable
        Tells seconds that never go back.
    """

    def __init__(
        self,
        kernel: Kernel,
        *,
        max_age_s: float = MAX_AGE_S,
        capacity: int = CAPACITY,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._kernel = kernel
        self._max_age_s = max_age_s
        self._capacity = capacity
        self._clock = clock
        self._now = _Snapshot()
        self._refreshing: asyncio.Task[None] | None = None

    async def tag(self, secret: str | None, map_id: str, channel: str | None) -> str | None:
        """Return the tag of what the key's holder should have, or None where the database has to be asked.

        Parameters
        ----------
        channel : str, optional
            By default the one that the robot follows.
        """
        if secret is None:
            return None
        for _ in range(2):  # a reading that had begun before may not tell of a write since
            if not self._is_fresh():
                await self._refresh()
        holder = self._now.holders.get(secret_digest(secret))
        if holder is None or not holder.value.actor.covers(map_id):
            return None
        place = place_of(map_id, channel, holder.value.follower)
        tag = self._now.tags.get(place)
        if tag is None:
            return None
        if holder.value.expires_at is not None and holder.value.expires_at <= self._kernel.now():
            return None
        holder.asked_at = tag.asked_at = self._clock()
        return tag_at(place, tag.value, holder.value.follower)

    def token(self) -> object:
        """Return what `remember` needs of the time before its rows were read."""
        return self._now, self._kernel.db.writes

    def remember(self, token: object, secret: str, found: Polled) -> None:
        """Keep what was read since the token, if nothing was written or read anew in between.

        To be called in the event loop, as `tag` is.
        """
        if token != self.token():
            return
        now = self._clock()
        holder = _Holder(found.actor, found.expires_at, found.follower)
        self._keep(self._now.holders, secret_digest(secret), _Entry(holder, now))
        place = found.pointer.map_id, found.pointer.name
        self._keep(self._now.tags, place, _Entry(pointer_tag(found.pointer), now))

    def _keep(self, entries: dict[K, _Entry[V]], key: K, entry: _Entry[V]) -> None:
        if key not in entries and len(entries) >= self._capacity:
            del entries[next(iter(entries))]
        entries[key] = entry

    def _is_fresh(self) -> bool:
        young = self._clock() - self._now.read_at <= self._max_age_s
        return young and self._now.writes == self._kernel.db.writes

    async def _refresh(self) -> None:
        """Read everything anew; who comes meanwhile waits for the same reading."""
        if self._refreshing is None:
            self._refreshing = asyncio.create_task(self._read())
            self._refreshing.add_done_callback(self._ended)
        await asyncio.shield(self._refreshing)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._refreshing = None
        if not task.cancelled():
            task.exception()  # whoever waited was told; nobody else has to be

    async def _read(self) -> None:
        old, now = self._now, self._clock()
        fresh = _Snapshot(read_at=now, writes=self._kernel.db.writes)
        holders, places = _asked(old.holders, now), _asked(old.tags, now)
        valid, current = await run_in_threadpool(self._rows, list(holders), list(places))
        for digest, follower in valid.items():
            entry = fresh.holders[digest] = holders[digest]
            if entry.value.follower != follower:
                entry.value = replace(entry.value, follower=follower)
        fresh.tags = {
            place: _Entry(current[place], entry.asked_at)
            for place, entry in places.items()
            if place in current
        }
        self._now = fresh

    def _rows(
        self, digests: list[str], places: list[Place]
    ) -> tuple[dict[str, Follower | None], dict[Place, str]]:
        valid: dict[str, Follower | None] = {}
        current: dict[Place, str] = {}
        if digests or places:
            with self._kernel.db.reading() as session:
                for begin in range(0, len(digests), _BATCH):
                    valid |= still_valid(session, digests[begin : begin + _BATCH])
                for begin in range(0, len(places), _BATCH):
                    current |= tags(session, places[begin : begin + _BATCH])
        return valid, current


def _asked(entries: dict[K, _Entry[V]], now: float) -> dict[K, _Entry[V]]:
    """Return the entries that somebody asked for of late."""
    return {key: entry for key, entry in entries.items() if now - entry.asked_at <= _FORGOTTEN_AFTER_S}
