"""Many keys and many pointers at once, for whoever answers polling robots from memory."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Channel, Key
from service.db.robots import Robot


def valid_digests(
    session: Session, digests: Collection[str]
) -> Sequence[tuple[str, tuple[str, str, int | None] | None]]:
    """Return those of the digests whose key exists and was not revoked.

    With each that is a robot's own: the robot's map and channel, and what a roll-out gives it.
    """
    wanted = (
        select(Key.digest, Robot.map_id, Robot.channel, Robot.assigned_n)
        .outerjoin(Robot, Robot.key_id == Key.id)
        .where(Key.digest.in_(digests), Key.revoked_at.is_(None))
    )
    return [(row[0], None if row[1] is None else (row[1], row[2], row[3])) for row in session.execute(wanted)]


def find_channels(session: Session, map_ids: Collection[str]) -> Sequence[Channel]:
    """Return the pointers of all channels of these maps."""
    return session.scalars(select(Channel).where(Channel.map_id.in_(map_ids))).all()
