"""Windows that every client of `dcz` takes, and the next larger ones."""

from __future__ import annotations

import pytest

from service.domain.dictionary import is_window_taken


@pytest.mark.parametrize(
    ("dictionary_bytes", "limit_bytes"),
    [
        (0, 8_000_000),
        (6_400_000, 8_000_000),
        (8_000_000, 10_000_000),
        (100_000_000, 125_000_000),
        (102_400_000, 128_000_000),
        (102_400_001, 128_000_000),
        (1_000_000_000, 128_000_000),
    ],
)
def test_a_window_is_below_the_limit(dictionary_bytes: int, limit_bytes: int) -> None:
    assert is_window_taken(dictionary_bytes, content_bytes=limit_bytes - 1)
    assert not is_window_taken(dictionary_bytes, content_bytes=limit_bytes)
