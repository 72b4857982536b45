"""Many keys and many pointers at once, for whoever answers polling robots from memory."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import Channel, Key


def valid_digests(session: Session, digests: Collection[str]) -> Sequence[str]:
    """Return those of the digests whose key exists and was not revoked."""
    wanted = select(Key.digest).where(Key.digest.in_(digests), Key.revoked_at.is_(None))
    return session.scalars(wanted).all()


def find_channels(session: Session, map_ids: Collection[str]) -> Sequence[Channel]:
    """Return the pointers of all channels of these maps."""
    return session.scalars(select(Channel).where(Channel.map_id.in_(map_ids))).all()
