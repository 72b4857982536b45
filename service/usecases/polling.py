"""What polling robots are answered from: whose key is valid, and where channels point, read in bulk."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy.orm import Session

from service.db.keys import find_by_digest
from service.db.models import Channel
from service.db.polling import find_channels, valid_digests
from service.domain.access import Actor
from service.usecases.keys import authenticate, secret_digest
from service.usecases.publish import pointer_tag, published_pointer

Place = tuple[str, str]
"""A map's id and the name of a channel."""


@dataclass(frozen=True)
class Polled:
    """Hold what one poll found: who asked, until when the key is valid, and the pointer with its tag."""

    actor: Actor
    expires_at: datetime | None
    pointer: Channel
    tag: str


def poll(session: Session, secret: str | None, *, place: Place, now: datetime) -> Polled:
    """Return where a channel points, for whoever holds the secret.

    Raises
    ------
    Unauthenticated
        As `authenticate`.
    MapNotFound, NothingPublished
        As `published_pointer`.
    """
    actor = authenticate(session, secret, now=now)
    pointer = published_pointer(session, actor, map_id=place[0], channel=place[1])
    key = None if secret is None else find_by_digest(session, secret_digest(secret))
    return Polled(actor, None if key is None else key.expires_at, pointer, pointer_tag(pointer))


def still_valid(session: Session, digests: Collection[str]) -> frozenset[str]:
    """Return those of the keys' digests that were not revoked."""
    return frozenset(valid_digests(session, digests))


def tags(session: Session, places: Sequence[Place]) -> Mapping[Place, str]:
    """Return the tag of each place that something is published at."""
    found = find_channels(session, {map_id for map_id, _ in places})
    return {(pointer.map_id, pointer.name): pointer_tag(pointer) for pointer in found}
