"""How much of a disk stays free for what cannot wait: rows of the database, files that are half done."""

from __future__ import annotations

RESERVE_BYTES = 1 << 30
"""Most that is kept free unless an operator says otherwise [bytes]: room for a day of rows and logs."""

RESERVE_SHARE = 0.05
"""Share of a small file system that is kept free in its place: what ext4 keeps for root (mke2fs -m)."""


def reserve_of(total_bytes: int) -> int:
    """Return how many bytes of a file system of this size stay free: 1 GiB or 5 %, the lesser.

    Examples
    --------
    >>> reserve_of(10 << 30) == (10 << 30) // 20
    True
    >>> reserve_of(10 << 40) == 1 << 30
    True
    """
    return min(RESERVE_BYTES, int(total_bytes * RESERVE_SHARE))
