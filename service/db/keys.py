"""API keys: found by the SHA-256 of their secret."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import datetime

from sqlalchemy import or_, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import Key
from service.domain.lifecycle import Role

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


def lock_admin_keys(session: Session, *, now: datetime) -> Sequence[Key]:
    """Return the valid admin keys of all maps; nobody else revokes one until the transaction ends.

    On PostgreSQL the rows are locked, and one that was revoked while this waited is not among them; on
    SQLite only one transaction writes at a time.
    """
    query = select(Key).where(
        Key.role == Role.ADMIN.value,
        Key.revoked_at.is_(None),
        or_(Key.expires_at.is_(None), Key.expires_at > now),
    )
    rows = session.scalars(query.order_by(Key.id).with_for_update().execution_options(populate_existing=True))
    return [key for key in rows if key.map_ids is None]


def list_keys(session: Session, *, after: str | None, limit: int) -> Sequence[Key]:
    """Return up to `limit` keys in the order of their making, after the id `after`."""
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
