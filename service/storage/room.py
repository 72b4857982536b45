"""How much room there is where an installation writes, and refusals before it is used up."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from service.domain.errors import StorageFull
from service.domain.reserve import reserve_of

RETRY_AFTER_S = 60
"""When a refused sender may ask again [s]: making room is a person's work."""

_SPARE_BYTES = 256 << 10
"""Room for some transactions in SQLite's log, pages of 4 KiB each."""

_FULL = {errno.ENOSPC, errno.EDQUOT}
_NEXT_WRITE_BYTES = 1 << 20
"""What buffered writers, and mappings of files, may ask for at once."""


BLOBS = frozenset({"blobs"})
"""Where a file goes that comes in one piece: it is staged beside the blobs."""

PIECES = frozenset({"uploads"})
"""Where an upload in pieces grows; in the end it becomes a blob, which is a copy where those have a disk."""


@dataclass(frozen=True)
class Space:
    """Hold how one file system stands.

    Parameters
    ----------
    name : str
        What lies on it: ``data``, ``uploads``, ``blobs`` or ``database``; the first of several.
    free_bytes, reserve_bytes : int
        What is free, and how much of it is kept in reserve.
    """

    name: str
    free_bytes: int
    reserve_bytes: int

    @property
    def is_full(self) -> bool:
        """Return whether less is free than is kept in reserve."""
        return self.free_bytes < self.reserve_bytes

    def refusal(self, more_bytes: int = 0) -> StorageFull:
        """Return the refusal of what would use up the reserve by `more_bytes` of files."""
        needed = f" and {more_bytes} are needed" if more_bytes else ""
        return StorageFull(
            f"The server's disk is full ({self.name}): {self.free_bytes} bytes are free, "
            f"{self.reserve_bytes} stay in reserve{needed}. Tell an admin; what is asked for works again"
            " as soon as there is room.",
            retry_after_s=RETRY_AFTER_S,
            free_bytes=self.free_bytes,
            reserve_bytes=self.reserve_bytes,
        )

    def did_not_do(self, tries: int) -> StorageFull:
        """Return why a job has failed that was begun so often with room like this, and filled the disk."""
        return StorageFull(
            f"The job needs more room on the server's disk than there is: it was begun {tries} times with "
            f"room above the reserve, the last time with {self.free_bytes} bytes free ({self.name}; "
            f"{self.reserve_bytes} stay in reserve), and found the disk full each time. Nothing was changed. "
            "Tell an admin to make more room than that; then retry the job, or ask for the revision anew.",
            free_bytes=self.free_bytes,
            reserve_bytes=self.reserve_bytes,
            tries=tries,
        )


class Room:
    """Look at the file systems on which an installation writes.

    Parameters
    ----------
    folders : mapping of str to Path
        What lies where. Folders of one file system are looked at as one.
    reserve_bytes : int, optional
        What is kept free on each; by default as `reserve_of` has it.
    """

    def __init__(self, folders: Mapping[str, Path], *, reserve_bytes: int | None = None) -> None:
        self._folders = dict(folders)
        self._reserve_bytes = reserve_bytes

    def spaces(self) -> list[Space]:
        """Return how each file system stands; one that is not there yet is left out."""
        return list(self._by_device().values())

    def scarcest(self) -> Space | None:
        """Return the file system with the least room above its reserve, or None where none is looked at."""
        return min(self.spaces(), key=lambda space: space.free_bytes - space.reserve_bytes, default=None)

    def is_used_up(self) -> bool:
        """Return whether some disk has no room for a next write, reserve or not."""
        return any(space.free_bytes < _NEXT_WRITE_BYTES for space in self.spaces())

    def refusal(self, more_bytes: int = 0, *, into: Collection[str] = BLOBS) -> StorageFull | None:
        """Return why nothing more may be begun, or `more_bytes` not be taken; None while there is room.

        Parameters
        ----------
        more_bytes : int, default 0
            What would be written.
        into : collection of str
            The folders that it is written to; of two on one file system, as one of them.
        """
        filled = {_device(folder) for name, folder in self._folders.items() if name in into}
        for device, space in self._by_device().items():
            more = more_bytes if device in filled else 0
            if Space(space.name, space.free_bytes - more, space.reserve_bytes).is_full:
                return space.refusal(more)
        return None

    def require(self, more_bytes: int = 0, *, into: Collection[str] = BLOBS) -> None:
        """Pass while the reserve stays untouched, also by `more_bytes` of files: see `refusal`.

        Raises
        ------
        StorageFull
            If it does not.
        """
        if (refusal := self.refusal(more_bytes, into=into)) is not None:
            raise refusal

    def _by_device(self) -> dict[int, Space]:
        seen: dict[int, Space] = {}
        for name, folder in self._folders.items():
            device = _device(folder)
            if device is not None and device not in seen:
                usage = shutil.disk_usage(folder)
                kept = reserve_of(usage.total) if self._reserve_bytes is None else self._reserve_bytes
                seen[device] = Space(name, usage.free, kept)
        return seen


def _device(folder: Path) -> int | None:
    return folder.stat().st_dev if folder.is_dir() else None


class Spare:
    """Keep some bytes of a disk that others fill, to be let go for the last words that have to be written.

    The file has no name: it is gone with its process.

    Parameters
    ----------
    folder : Path
        A folder on the disk; it need not be there yet.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file: IO[bytes] | None = None

    def hold(self) -> None:
        """Take the bytes, if they are not held and there is room."""
        if self._file is not None:
            return
        with suppress(OSError):
            file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115 - held until it is let go
            try:
                os.posix_fallocate(file.fileno(), 0, _SPARE_BYTES)
            except OSError:
                file.close()
            else:
                self._file = file

    def let_go(self) -> None:
        """Give the bytes back."""
        if self._file is not None:
            self._file.close()
            self._file = None


def spare_for_start(folder: Path, room: Room) -> None:
    """Keep some bytes in a file beside SQLite's, and give them back where a start finds the disk full.

    SQLite makes 32 KiB of files before it reads anything at all, once all had left the database.
    """
    spare = folder / ".spare-for-start"
    if room.is_used_up():
        spare.unlink(missing_ok=True)
    elif not spare.exists():
        with suppress(OSError), spare.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, _SPARE_BYTES)


def tells_full_disk(error: BaseException | None) -> bool:
    """Return whether an error, or one that it comes from, says that a disk or a quota is full."""
    while error is not None:
        if isinstance(error, StorageFull) or (isinstance(error, OSError) and error.errno in _FULL):
            return True
        error = error.__cause__ or error.__context__
    return False


def found_full() -> StorageFull:
    """Return the refusal of work that found no room for its next byte."""
    return StorageFull(
        "The server's disk is full. Tell an admin; what is asked for works again as soon as there is room.",
        retry_after_s=RETRY_AFTER_S,
    )


@contextmanager
def full_disk_refused() -> Iterator[None]:
    """Turn "no space" and "quota exceeded" of the operating system into `StorageFull`."""
    try:
        yield
    except OSError as error:
        if error.errno not in _FULL:
            raise
        raise found_full() from error
