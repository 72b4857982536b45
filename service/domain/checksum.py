"""The checksum that comes with a piece of an upload."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac

from service.domain.errors import ChecksumMismatch, ChecksumUnsupported

ALGORITHMS = ("sha1", "sha256")


class Checksum:
    """A digest that a sender announced, compared with that of the bytes that came.

    Parameters
    ----------
    header : str
        ``algorithm base64``, as tus 1.0 writes it in ``Upload-Checksum``.

    Raises
    ------
    ChecksumUnsupported
        If the algorithm is not known, or the rest is no digest of its length.

    Examples
    --------
    >>> checksum = Checksum("sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0=")
    >>> checksum.update(b"hello world")
    >>> checksum.verify()
    """

    def __init__(self, header: str) -> None:
        algorithm, _, encoded = header.partition(" ")
        if algorithm not in ALGORITHMS:
            raise ChecksumUnsupported(
                f"The checksum algorithm {algorithm[:40]!r} is not known; known are {', '.join(ALGORITHMS)}.",
                algorithms=list(ALGORITHMS),
            )
        self._sum = hashlib.new(algorithm, usedforsecurity=False)
        try:
            self._announced = base64.b64decode(encoded, validate=True)
        except (binascii.Error, ValueError):
            self._announced = b""
        if len(self._announced) != self._sum.digest_size:
            raise ChecksumUnsupported(
                f"The checksum is no {algorithm} digest of {self._sum.digest_size} bytes in base64.",
                algorithms=list(ALGORITHMS),
            )

    def update(self, chunk: bytes) -> None:
        """Take the next bytes that came."""
        self._sum.update(chunk)

    def verify(self) -> None:
        """Pass when all the bytes that came have the announced digest.

        Raises
        ------
        ChecksumMismatch
            If they have another.
        """
        if not hmac.compare_digest(self._sum.digest(), self._announced):
            raise ChecksumMismatch(
                "The piece was damaged on the way and has been discarded; send it again from the same offset."
            )
