"""Bytes first, rows second: and where the rows do not come, the bytes go again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from service.db.blobs import is_recorded
from service.domain.errors import DomainError
from service.storage.blobs import NewBlob
from service.usecases.kernel import Kernel


@contextmanager
def bytes_first(kernel: Kernel) -> Iterator[None]:
    """Take back the blobs that the block made new, where it ends by an exception and no row names them.

    What a crash leaves, and what the database cannot be asked about now, is swept an hour later.
    """
    with kernel.blobs.noting() as made:
        try:
            yield
        except BaseException:
            with suppress(DomainError, OSError):
                _take_back(kernel, made)
            raise


def _take_back(kernel: Kernel, made: list[NewBlob]) -> None:
    with kernel.db.reading() as session:
        orphans = [one for one in made if not is_recorded(session, one.sha256)]
    for one in orphans:
        kernel.blobs.discard(one)
