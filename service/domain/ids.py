"""Names of things: sortable by the time they were made, prefixed by their kind."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"

Clock = Callable[[], datetime]
Entropy = Callable[[int], bytes]


def new_id(prefix: str, *, now: datetime, entropy: Entropy) -> str:
    """Return ``prefix_`` and 26 characters: 48 bits of milliseconds, then 80 random bits (as ULID).

    Ids made later sort later, up to a millisecond. `entropy` gives n random bytes: `secrets.token_bytes`
    in the composition roots, a seeded generator in tests.
    """
    value = int(now.timestamp() * 1000) << 80 | int.from_bytes(entropy(10), "big")
    return prefix + "_" + "".join(_ALPHABET[value >> shift & 31] for shift in range(125, -5, -5))
