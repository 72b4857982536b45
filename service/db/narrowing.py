"""Which rows of a list are wanted: one form for every list that a dashboard asks for."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, TypeVar

from sqlalchemy import Select, func

from service.domain.ids import first_id_at

Q = TypeVar("Q", bound=Select[*tuple[Any, ...]])


@dataclass(frozen=True)
class Narrowing:
    """Hold which rows are wanted, and in which order; ids sort by time, so an index serves each of these.

    Parameters
    ----------
    limit : int
        The most rows.
    covered : collection of str, optional
        Only rows of these maps; None is all.
    equals : mapping of str to object
        Only rows whose column of this name has this value; None asks for nothing.
    contains : tuple of str, optional
        A column's name and a text that it has to contain, whatever its case.
    since, until : datetime, optional
        Only rows made from `since` on and before `until`.
    newest_first : bool
        Else oldest first.
    after : str, optional
        Only rows after the one of this id, in that order.
    """

    limit: int
    covered: Collection[str] | None = None
    equals: Mapping[str, object] = field(default_factory=dict)
    contains: tuple[str, str] | None = None
    since: datetime | None = None
    until: datetime | None = None
    newest_first: bool = True
    after: str | None = None


def narrowed(query: Q, table: Any, wanted: Narrowing, *, prefix: str) -> Q:
    """Return a query of a table's rows, narrowed.

    Parameters
    ----------
    table : mapped class
        Has the columns `id`, `map_id` and those that `wanted` names.
    prefix : str
        Of the table's ids.
    """
    if wanted.covered is not None:
        query = query.where(table.map_id.in_(wanted.covered))
    for name, value in wanted.equals.items():
        if value is not None:
            query = query.where(getattr(table, name) == value)
    if wanted.contains is not None:
        name, text = wanted.contains
        query = query.where(func.lower(getattr(table, name)).contains(text.lower(), autoescape=True))
    if wanted.since is not None:
        query = query.where(table.id >= first_id_at(prefix, wanted.since))
    if wanted.until is not None:
        query = query.where(table.id < first_id_at(prefix, wanted.until))
    if wanted.after is not None:
        query = query.where(table.id < wanted.after if wanted.newest_first else table.id > wanted.after)
    return query.order_by(table.id.desc() if wanted.newest_first else table.id).limit(wanted.limit)
