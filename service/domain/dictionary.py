"""What a client that keeps dictionaries (RFC 9842) has to be able to decode."""

from __future__ import annotations

SURE_WINDOW_BYTES = 8_000_000
LARGEST_WINDOW_BYTES = 128_000_000
_GROWTH = 1.25


def is_window_taken(dictionary_bytes: int, *, content_bytes: int) -> bool:
    """Return whether every client of the coding `dcz` decodes a content with a dictionary of this size.

    The window of a delta is its whole content, so that the dictionary stays in reach to its end.

    Notes
    -----
    RFC 9842, "Dictionary-Compressed Zstandard": a client takes windows up to 8 MB or 1.25 times the
    dictionary, whichever is greater, and up to 128 MB; a window has to be lower than that, and a client may
    refuse what is not. MB is read as 10^6 bytes, the smaller of what it may mean.

    Examples
    --------
    >>> is_window_taken(1_000, content_bytes=7_999_999), is_window_taken(1_000, content_bytes=8_000_000)
    (True, False)
    """
    limit = min(max(SURE_WINDOW_BYTES, _GROWTH * dictionary_bytes), LARGEST_WINDOW_BYTES)
    return content_bytes < limit
