"""What polling robots are answered from: whose key is valid, and what each should have, read in bulk."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple

from service.db.keys import find_by_digest
from service.db.models import Channel
from service.db.polling import find_channels, valid_digests
from service.db.robots import find_robot_of_key
from service.db.session import Session
from service.domain.access import Actor
from service.domain.lifecycle import Role
from service.usecases.keys import authenticate, secret_digest
from service.usecases.publish import pointer_tag, published_pointer

Place = tuple[str, str]
"""A map's id and the name of a channel."""

DEFAULT_CHANNEL = "stable"


class Follower(NamedTuple):
    """Hold what the holder of a robot's key follows, and the revision that a roll-out gives it."""

    map_id: str
    channel: str
    assigned_n: int | None


@dataclass(frozen=True)
class Polled:
    """Hold what one poll found: who asked, until when the key is valid, and what it should have.

    `n` is the revision, `tag` changes whenever another answer is due.
    """

    actor: Actor
    expires_at: datetime | None
    follower: Follower | None
    pointer: Channel
    n: int
    tag: str


def place_of(map_id: str, channel: str | None, follower: Follower | None) -> Place:
    """Return which pointer is meant: without a channel that which the robot follows, else `stable`."""
    if channel is None and follower is not None and follower.map_id == map_id:
        return map_id, follower.channel
    return map_id, channel or DEFAULT_CHANNEL


def assigned_at(place: Place, follower: Follower | None) -> int | None:
    """Return the revision that a roll-out gives the robot at this place, or None."""
    if follower is None or (follower.map_id, follower.channel) != place:
        return None
    return follower.assigned_n


def tag_at(place: Place, tag: str, follower: Follower | None) -> str:
    """Return the tag of what the robot should have: the pointer's, or that of what a roll-out gives it."""
    n = assigned_at(place, follower)
    return tag if n is None else f"{tag}-r{n}"


def poll(session: Session, secret: str | None, *, map_id: str, channel: str | None, now: datetime) -> Polled:
    """Return what the holder of the secret should have.

    Parameters
    ----------
    channel : str, optional
        By default the one that the robot follows, for its own key; else `stable`.

    Raises
    ------
    Unauthenticated
        As `authenticate`.
    MapNotFound, NothingPublished
        As `published_pointer`.
    """
    actor = authenticate(session, secret, now=now)
    robot = find_robot_of_key(session, actor.key_id) if actor.role is Role.ROBOT else None
    follower = None if robot is None else Follower(robot.map_id, robot.channel, robot.assigned_n)
    place = place_of(map_id, channel, follower)
    pointer = published_pointer(session, actor, map_id=map_id, channel=place[1])
    key = None if secret is None else find_by_digest(session, secret_digest(secret))
    return Polled(
        actor,
        None if key is None else key.expires_at,
        follower,
        pointer,
        assigned_at(place, follower) or pointer.revision_n,
        tag_at(place, pointer_tag(pointer), follower),
    )


def still_valid(session: Session, digests: Collection[str]) -> Mapping[str, Follower | None]:
    """Return those of the keys' digests that were not revoked, each with what its robot follows."""
    return {
        digest: None if robot is None else Follower(*robot)
        for digest, robot in valid_digests(session, digests)
    }


def tags(session: Session, places: Sequence[Place]) -> Mapping[Place, str]:
    """Return the tag of each place that something is published at."""
    found = find_channels(session, {map_id for map_id, _ in places})
    return {(pointer.map_id, pointer.name): pointer_tag(pointer) for pointer in found}
