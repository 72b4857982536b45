"""API keys: found by the SHA-256 of their secret."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import datetime

from sqlalchemy import or_, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import Key

_BATCH = 500


def find_by_digest(session: Session, digest: str) -> Key | None:
    """Return the key whose secret has this SHA-256 (hex), or None."""
    return session.scalars(select(Key).where(Key.digest == digest)).one_or_none()


def find_key(session: Session, key_id: str) -> Key | None:
    """Return the key with this id, or None."""
    return session.get(Key, key_id)


def valid_keys(session: Session, key_ids: Collection[str], *, now: datetime) -> set[str]:
    """Return those of the keys that exist, were not revoked and have not expired."""
    wanted, valid = sorted(key_ids), set[str]()
    for begin in range(0, len(wanted), _BATCH):
        lasting = or_(Key.expires_at.is_(None), Key.expires_at > now)
        query = select(Key.id).where(Key.id.in_(wanted[begin : begin + _BATCH]), Key.revoked_at.is_(None))
        valid |= set(session.scalars(query.where(lasting)))
    return valid


def list_keys(session: Session, *, after: str | None, limit: int) -> Sequence[Key]:
    """Return up to `limit` keys in the order of their making, from behind the id `after`."""
    query = select(Key).order_by(Key.id).limit(limit)
    if after is not None:
        query = query.where(Key.id > after)
    return session.scalars(query).all()


def add_key(session: Session, key: Key) -> bool:
    """Return whether the key was added; False when its id is taken."""
    try:
        with session.begin_nested():
            session.add(key)
    except IntegrityError:
        return False
    return True


def is_empty(session: Session) -> bool:
    """Return whether no key was ever made."""
    return session.scalar(select(Key.id).limit(1)) is None


def revoke_key(session: Session, key_id: str, *, now: datetime) -> None:
    """Make the key invalid from `now` on; revoking it twice keeps the first instant."""
    session.execute(update(Key).where(Key.id == key_id, Key.revoked_at.is_(None)).values(revoked_at=now))
