"""Rows of stored bytes."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import Engine, inspect, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.db.models import Blob


def record_blob(session: Session, sha256: str, *, size_bytes: int, media_type: str, now: datetime) -> None:
    """Make sure that the blob has its row, so that other rows may name it and no sweep takes it.

    The bytes have to be in the store before. A row that is there already stays as it is.
    """
    values = {"sha256": sha256, "size_bytes": size_bytes, "media_type": media_type, "created_at": now}
    if session.get_bind().dialect.name == "postgresql":
        session.execute(postgresql.insert(Blob).values(values).on_conflict_do_nothing())
    else:
        session.execute(sqlite.insert(Blob).values(values).on_conflict_do_nothing())


def is_recorded(session: Session, sha256: str) -> bool:
    """Return whether the blob has a row."""
    return session.get(Blob, sha256) is not None


def has_blobs(engine: Engine) -> bool:
    """Return whether some blob has a row, in a database of any version; a new one has no table for them."""
    with engine.connect() as connection:
        if not inspect(connection).has_table(Blob.__tablename__):
            return False
        return connection.execute(select(Blob.sha256).limit(1)).first() is not None


def blob_size(session: Session, sha256: str) -> int | None:
    """Return the size of a blob [bytes], or None if it has no row."""
    row = session.get(Blob, sha256)
    return None if row is None else row.size_bytes
