"""Rights that one process has at a time, by name, until it lets them run out."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import delete, func, or_, select
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from service.db.models import Lease


def hold_lease(session: Session, name: str, *, holder: str, lease_s: float, now: datetime) -> str:
    """Return who holds a lease now: `holder`, anew for `lease_s`, if it was free, run out, or its own.

    Parameters
    ----------
    now : datetime
        The present, with a time zone; on PostgreSQL its own clock counts, which all machines share.
    """
    is_sqlite = session.get_bind().dialect.name == "sqlite"
    present = now if is_sqlite else session.execute(select(func.clock_timestamp())).scalar_one()
    insert = (sqlite if is_sqlite else postgresql).insert(Lease)
    wanted = insert.values(name=name, holder=holder, until=present + timedelta(seconds=lease_s))
    session.execute(
        wanted.on_conflict_do_update(
            index_elements=[Lease.name],
            set_={"holder": wanted.excluded.holder, "until": wanted.excluded.until},
            where=or_(Lease.holder == holder, Lease.until < present),
        )
    )
    return session.execute(select(Lease.holder).where(Lease.name == name)).scalar_one()


def end_lease(session: Session, name: str, *, holder: str) -> None:
    """Let go of a lease, if it is the holder's."""
    session.execute(delete(Lease).where(Lease.name == name, Lease.holder == holder))
