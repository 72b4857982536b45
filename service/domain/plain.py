"""What is kept of text and numbers from outside: only what every database and every reader takes."""

from __future__ import annotations

import json
import math
import re
from typing import Any

REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
"""Stands where something stood that no text may hold, one for one: a text never grows."""

_NO_TEXT = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
_ESCAPED = re.compile(r"\\u(?:[dD][89a-fA-F]|00(?:[0189][0-9a-fA-F]|7[fF]))")
_LARGEST_WHOLE = 2**63 - 1


def plain_text(text: str) -> str:
    """Return a text without surrogates, NUL and other control characters; tabs and line ends stay.

    Notes
    -----
    A lone surrogate has no UTF-8, so an answer that holds one cannot be sent; PostgreSQL stores neither it
    nor NUL (its manual, 8.14 JSON Types). Other control characters steer terminals that show a log.
    """
    return _NO_TEXT.sub(REPLACEMENT, text)


def plain(value: Any) -> Any:
    """Return a JSON value whose texts are plain, and in which null stands for numbers that JSON has not.

    Those are NaN, the infinities, and whole numbers of more than 64 bits.
    """
    if isinstance(value, str):
        return plain_text(value)
    if isinstance(value, dict):
        return {plain_text(k) if isinstance(k, str) else k: plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, int) and abs(value) > _LARGEST_WHOLE:
        return None
    return value


def plain_dumps(value: Any) -> str:
    """Return a JSON value, made plain, as JSON text."""
    return json.dumps(plain(value), allow_nan=False)


def plain_loads(text: str | bytes) -> Any:
    """Return the JSON value of a text that may have been stored before values were made plain."""
    told = text.decode() if isinstance(text, bytes) else text
    value = json.loads(told, parse_constant=lambda _: None)
    return plain(value) if _ESCAPED.search(told) else value
