"""Pages of lists: an opaque cursor that holds where to go on, and only fits the filters it was made for."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Query, Request

from service.domain.errors import InvalidRequest

R = TypeVar("R")
S = TypeVar("S")


@dataclass(frozen=True)
class Paging:
    """Hold what a request asks of a list: how many items, and after which.

    Parameters
    ----------
    limit : int
        Most items on a page.
    after : str or int, optional
        Key of the last item of the page before.
    filters : str
        Fingerprint of the path and the filters.
    """

    limit: int
    after: str | int | None
    filters: str

    def after_id(self) -> str | None:
        """Return `after` of a list whose key is text."""
        return self._after(str)

    def after_n(self) -> int | None:
        """Return `after` of a list whose key is a number."""
        return self._after(int)

    def page(
        self, rows: Sequence[R], *, key: Callable[[R], str | int], show: Callable[[R], S]
    ) -> dict[str, Any]:
        """Return the members of a page from up to ``limit + 1`` rows: one more tells that there are more."""
        shown = rows[: self.limit]
        more = len(rows) > self.limit
        return {
            "items": [show(row) for row in shown],
            "next_cursor": _encode(key(shown[-1]), self.filters) if more else None,
        }

    def _after(self, kind: type[R]) -> R | None:
        if self.after is not None and type(self.after) is not kind:
            raise _bad_cursor()
        return self.after


def _paging(
    request: Request,
    limit: Annotated[int, Query(ge=1, le=200, description="Most items on the page.")] = 50,
    cursor: Annotated[
        str | None, Query(max_length=500, description="`next_cursor` of the page before.")
    ] = None,
) -> Paging:
    asked = sorted((k, v) for k, v in request.query_params.multi_items() if k not in {"limit", "cursor"})
    filters = hashlib.sha256(json.dumps([request.url.path, asked]).encode()).hexdigest()[:16]
    return Paging(limit, None if cursor is None else _decode(cursor, filters), filters)


PagingDep = Annotated[Paging, Depends(_paging)]


def _encode(after: str | int, filters: str) -> str:
    return base64.urlsafe_b64encode(json.dumps([after, filters]).encode()).decode().rstrip("=")


def _decode(cursor: str, filters: str) -> str | int:
    try:
        padded = cursor.encode("ascii") + b"=" * (-len(cursor) % 4)
        after, made_for = json.loads(base64.b64decode(padded, altchars=b"-_", validate=True))
    except (ValueError, TypeError, binascii.Error, RecursionError) as error:
        raise _bad_cursor() from error
    fits = isinstance(after, str) and "\x00" not in after and after.isprintable()
    if made_for != filters or not (fits or (type(after) is int and abs(after) < 2**31)):
        raise _bad_cursor()
    position: str | int = after
    return position


def _bad_cursor() -> InvalidRequest:
    detail = "The cursor is none that this list gave for these filters; begin again without it."
    return InvalidRequest(detail, errors=[{"parameter": "cursor", "detail": detail}])
