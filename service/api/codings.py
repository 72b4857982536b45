"""Content codings that a client takes (RFC 9110, 12.5.3), and the dictionary that it has (RFC 9842)."""

from __future__ import annotations

import base64
import binascii
import re

_ITEM = re.compile(
    r"\s*([!#$%&'*+.^_`|~0-9A-Za-z-]+)\s*(?:;\s*[qQ]\s*=\s*(0(?:\.\d{0,3})?|1(?:\.0{0,3})?))?\s*"
)
_SHA256_BYTES = 32


def takes(header: str | None, coding: str) -> bool:
    """Return whether `Accept-Encoding` lets `coding` be sent, and no worse than the bare file.

    Without the header, or where it cannot be read, the bare file is the one that every client can use.

    Examples
    --------
    >>> takes("gzip, zstd;q=0.8", "zstd")
    True
    >>> takes("zstd;q=0.5, identity", "zstd")
    False
    """
    weights = _weights(header or "")
    weight = weights.get(coding, weights.get("*", 0.0))
    return weight > 0.0 and weight >= weights.get("identity", 0.0)


def takes_bare(header: str | None) -> bool:
    """Return whether `Accept-Encoding` lets the bare file be sent: only a weight of 0 forbids it.

    Examples
    --------
    >>> takes_bare("zstd"), takes_bare("zstd, *;q=0"), takes_bare("identity;q=0")
    (True, False, False)
    """
    weights = _weights(header or "")
    return weights.get("identity", weights.get("*", 1.0)) > 0.0


def dictionary_of(header: str | None) -> str | None:
    """Return the SHA-256 (hex) that `Available-Dictionary` names, a byte sequence of RFC 9651, or None."""
    value = (header or "").strip()
    if len(value) < 2 or value[0] != ":" or value[-1] != ":":
        return None
    try:
        digest = base64.b64decode(value[1:-1], validate=True)
    except (ValueError, binascii.Error):
        return None
    return digest.hex() if len(digest) == _SHA256_BYTES else None


def _weights(header: str) -> dict[str, float]:
    weights: dict[str, float] = {}
    for item in header.split(","):
        found = _ITEM.fullmatch(item)
        if found is not None:
            weights[found[1].lower()] = 1.0 if found[2] is None else float(found[2])
    return weights
