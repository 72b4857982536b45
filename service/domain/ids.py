"""Names of things: sortable by the time they were made, prefixed by their kind."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
_CHARACTERS = 26

Clock = Callable[[], datetime]
Entropy = Callable[[int], bytes]


def made_at(id_: str) -> datetime:
    """Return when an id was made, to the millisecond, by its last 26 characters.

    Raises
    ------
    ValueError
        If it is no id.
    """
    characters = id_[-_CHARACTERS:]
    if len(characters) < _CHARACTERS or not set(characters) <= set(_ALPHABET):
        msg = f"{id_!r} does not end as an id does"
        raise ValueError(msg)
    value = 0
    for character in characters:
        value = value << 5 | _ALPHABET.index(character)
    try:
        return datetime.fromtimestamp((value >> 80) / 1000, UTC)
    except (OverflowError, OSError) as error:
        msg = f"{id_!r} was made at no time"
        raise ValueError(msg) from error


def first_id_at(prefix: str, moment: datetime) -> str:
    """Return the id before which every id of this kind was made earlier than `moment`, to the millisecond."""
    return new_id(prefix, now=moment, entropy=bytes)


def new_id(prefix: str, *, now: datetime, entropy: Entropy) -> str:
    """Return ``prefix_`` and 26 characters: 48 bits of milliseconds, then 80 random bits (as ULID).

    Ids made later sort later, up to a millisecond. `entropy` gives n random bytes: `secrets.token_bytes`
    in the composition roots, a seeded generator in tests.
    """
    value = int(now.timestamp() * 1000) << 80 | int.from_bytes(entropy(10), "big")
    return prefix + "_" + "".join(_ALPHABET[value >> shift & 31] for shift in range(125, -5, -5))
