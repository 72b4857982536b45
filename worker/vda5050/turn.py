"""Whose turn it is: of several bridges one works, and the others wait for it to end."""

from __future__ import annotations

import time
from collections.abc import Callable

import structlog

from service.db.leases import end_lease, hold_lease
from service.domain.errors import Unavailable
from service.usecases.kernel import Kernel

_NAME = "vda5050"

log = structlog.get_logger(__name__)


class Turn:
    """Hold the right to be the active bridge, as a lease in the database.

    Parameters
    ----------
    kernel : Kernel
        Where the lease is.
    holder : str
        Name of this process, which no other has.
    lease_s, beat_s : float
        How long the right lasts without a beat, and how often there is one [s].
    clock : callable
        Tells seconds that never go back.
    """

    def __init__(
        self,
        kernel: Kernel,
        *,
        holder: str,
        lease_s: float,
        beat_s: float,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._kernel = kernel
        self._holder = holder
        self._lease_s = lease_s
        self._beat_s = beat_s
        self._clock = clock
        self._until = self._beat_at = float("-inf")
        self._waits_for: str | None = None

    def is_ours(self) -> bool:
        """Return whether this process is the active bridge; it asks for the right when a beat is due."""
        now = self._clock()
        if now >= self._beat_at:
            self._beat_at = now + self._beat_s
            self._beat(now)
        return self._clock() < self._until

    def end(self) -> None:
        """Let the next one begin at once."""
        self._until = float("-inf")
        with self._kernel.db.writing("end-bridge-lease") as session:
            end_lease(session, _NAME, holder=self._holder)

    def _beat(self, now: float) -> None:
        try:
            with self._kernel.db.writing("hold-bridge-lease") as session:
                holder = hold_lease(
                    session, _NAME, holder=self._holder, lease_s=self._lease_s, now=self._kernel.now()
                )
        except Unavailable as error:
            log.warning("the database did not answer", why=error.detail)
            return
        self._until = now + self._lease_s if holder == self._holder else float("-inf")
        if holder not in {self._holder, self._waits_for}:
            log.info("another bridge is active; this one waits", active=holder)
        self._waits_for = holder
