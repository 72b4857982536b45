"""Bytes first, rows second: and where the rows do not come, the bytes go again."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from service.db.blobs import is_recorded
from service.domain.errors import DomainError
from service.storage.blobs import NewBlob
from service.usecases.kernel import Kernel


@contextmanager
def bytes_first(kernel: Kernel) -> Iterator[None]:
    """Take back the blobs that the block made new, where it ends by an exception and no row names them.

    What a crash leaves, and what the database cannot be asked about now, is swept an hour later. So is what
    a commit without an answer was to name: its rows may come after whoever looks for them at once.
    """
    with kernel.blobs.noting() as made, unless_rows_may_come(kernel, lambda: _take_back(kernel, made)):
        yield


@contextmanager
def unless_rows_may_come(kernel: Kernel, take_back: Callable[[], None]) -> Iterator[None]:
    """Call `take_back` where the block ends by an exception, and every commit was answered or never sent."""
    before = kernel.db.unsure_commits
    try:
        yield
    except BaseException:
        if kernel.db.unsure_commits == before:
            with suppress(DomainError, OSError):
                take_back()
        raise


def _take_back(kernel: Kernel, made: list[NewBlob]) -> None:
    with kernel.db.reading() as session:
        orphans = [one for one in made if not is_recorded(session, one.sha256)]
    for one in orphans:
        kernel.blobs.discard(one)
