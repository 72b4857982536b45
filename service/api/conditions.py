"""Conditions of requests: entity tags and byte ranges (RFC 9110, sections 8.8.3, 13 and 14)."""

from __future__ import annotations

import re

from starlette.requests import Request

_TAG = re.compile(r'\s*(W/)?"([\x21\x23-\x7e\x80-\xff]*)"\s*(?:,|$)')
_RANGE = re.compile(r"bytes\s*=\s*(\d*)\s*-\s*(\d*)\s*", re.IGNORECASE)
_MOST_DIGITS = 18


def listed(request: Request, name: str) -> str | None:
    """Return a header that is a list, its lines put together; None where it did not come."""
    return ", ".join(request.headers.getlist(name)) if name in request.headers else None


def none_match(header: str | None, tag: str) -> bool:
    """Return whether `If-None-Match` does not name the tag, so that the whole answer is due.

    Compares weakly: ``W/"x"`` names ``"x"`` too. A header that cannot be read names nothing.
    """
    return header is None or not _names(header, tag, weakly=True)


def match(header: str, tag: str | None) -> bool:
    """Return whether `If-Match` names the tag; None means that there is nothing yet. Compares strongly."""
    return tag is not None and _names(header, tag, weakly=False)


def range_applies(if_range: str | None, tag: str) -> bool:
    """Return whether a range may be answered: without `If-Range`, or when it names the tag strongly."""
    return if_range is None or if_range.strip() == f'"{tag}"'


def one_range(header: str | None, size: int) -> tuple[int, int] | None:
    """Return the first byte and the byte after the last that `Range` asks for; None means all of it.

    Several ranges, another unit, or what cannot be read are ignored, as the standard allows.

    Raises
    ------
    ValueError
        If the range lies outside of the `size` bytes.
    """
    found = None if header is None else _RANGE.fullmatch(header.strip())
    if found is None:
        return None
    first, last = found.groups()
    if len(first) > _MOST_DIGITS or len(last) > _MOST_DIGITS or not (first or last):
        return None
    if not first:
        begin, end = max(0, size - int(last)), size
    else:
        begin, end = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < begin:
            return None
    if begin >= end:
        msg = f"bytes {begin} to {end} of {size}"
        raise ValueError(msg)
    return begin, end


def _names(header: str, tag: str, *, weakly: bool) -> bool:
    if header.strip() == "*":
        return True
    position = 0
    while position < len(header):
        found = _TAG.match(header, position)
        if found is None:
            return False
        if found[2] == tag and (weakly or not found[1]):
            return True
        position = found.end()
    return False
