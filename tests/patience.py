"""How long a test waits for what must come: longer than a loaded machine needs, shorter than a test may take.

A process that ends is noticed at once; the seconds here only end a test that would hang. What has to be
quick is measured in benchmarks.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

PATIENCE_S = 240.0
_SHORTEST_S, _LONGEST_S = 0.005, 0.25
_SHARE = 0.05
"""Of the time waited so far, how long the next pause is: who asks seldom takes nothing from what runs."""

T = TypeVar("T")


def soon(
    look: Callable[[], T | None], told: Callable[[], object] | str = "it did not come to that", *,
    patience_s: float = PATIENCE_S,
) -> T:  # fmt: skip
    """Return what `look` finds, something or true; fail with what is `told` when it never does."""
    begun = time.monotonic()
    while not (found := look()):
        waited = time.monotonic() - begun
        assert waited < patience_s, told if isinstance(told, str) else told()
        time.sleep(min(max(_SHARE * waited, _SHORTEST_S), _LONGEST_S))
    return found
