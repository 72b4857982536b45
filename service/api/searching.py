"""What lists over all maps share: a period, an order, and where to go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from fastapi import Depends, Query
from pydantic import AwareDatetime

from service.api.paging import Paging, PagingDep
from service.api.schemas.base import Identifier
from service.db.narrowing import Narrowing


@dataclass(frozen=True)
class Search:
    """Hold what a request asks of a list, whatever the list is of."""

    paging: Paging
    map_id: str | None
    period: tuple[AwareDatetime | None, AwareDatetime | None]
    newest_first: bool

    def wanted(
        self, equals: Mapping[str, object], *, contains: tuple[str, str | None] | None = None
    ) -> Narrowing:
        """Return which rows are asked for, one more than a page holds.

        Parameters
        ----------
        equals : mapping
            Filters of this list: column to value, None for none.
        contains : tuple, optional
            The column that a text is looked for in, and the text or None.
        """
        text = None if contains is None or contains[1] is None else (contains[0], contains[1])
        since, until = self.period
        return Narrowing(
            limit=self.paging.limit + 1,
            equals={"map_id": self.map_id, **equals},
            contains=text,
            since=since,
            until=until,
            newest_first=self.newest_first,
            after=self.paging.after_id(),
        )


def _search(
    paging: PagingDep,
    map_id: Annotated[Identifier | None, Query(alias="map", description="Only of this map.")] = None,
    since: Annotated[AwareDatetime | None, Query(description="Only made from this instant on.")] = None,
    until: Annotated[AwareDatetime | None, Query(description="Only made before this instant.")] = None,
    order: Annotated[Literal["newest", "oldest"], Query(description="Which comes first.")] = "newest",
) -> Search:
    return Search(paging, map_id, (since, until), order == "newest")


SearchDep = Annotated[Search, Depends(_search)]
