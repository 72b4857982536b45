"""What every use case stands on: database, blobs, clock and randomness, passed in and never global."""

from __future__ import annotations

from dataclasses import dataclass, field

from service.db.session import Database
from service.domain.ids import Clock, Entropy, new_id
from service.storage.blobs import BlobStore
from service.storage.room import Room


@dataclass(frozen=True)
class Kernel:
    """Hold the outside world as a use case may see it; without a `room`, none is kept in reserve."""

    db: Database
    blobs: BlobStore
    now: Clock
    entropy: Entropy
    room: Room = field(default_factory=lambda: Room({}))

    def new_id(self, prefix: str) -> str:
        """Return a new id of the kind `prefix`, made at the present time."""
        return new_id(prefix, now=self.now(), entropy=self.entropy)
