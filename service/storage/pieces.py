"""Files that grow piece by piece over many requests, and survive a crash between any two bytes."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from service import crash_points
from service.domain.errors import UploadBusy, UploadExpired, UploadTooLarge
from service.storage.room import full_disk_refused

_ID = re.compile(r"[a-z]+_[0-9a-z]{1,40}")
_COPY_BYTES = 1 << 20
_BUSY_FOR_S = 1


class Appender:
    """The one writer of a file at a time; what it wrote is on disk when its block ends.

    Parameters
    ----------
    fd : int
        The file, locked, open for reading and appending.
    aside : Path
        Where a piece waits that has to be verified before it counts.
    max_bytes : int
        Size that the whole file will have.
    """

    def __init__(self, fd: int, aside: Path, *, max_bytes: int) -> None:
        self._fd = fd
        self._aside = aside
        self._aside_fd: int | None = None
        self._max_bytes = max_bytes
        self.size_bytes = os.fstat(fd).st_size
        self._aside_size = 0

    def write(self, chunk: bytes) -> None:
        """Append bytes that count as soon as they are written.

        Raises
        ------
        UploadTooLarge
            If the file would outgrow its announced size; nothing of `chunk` is written then.
        StorageFull
            If the disk has no room.
        """
        self._check_room(len(chunk))
        self.size_bytes += _write_all(self._fd, chunk)

    def write_aside(self, chunk: bytes) -> None:
        """Keep bytes that do not count until `accept` is called; without it they are gone.

        Raises
        ------
        UploadTooLarge, StorageFull
            As `write`.
        """
        self._check_room(self._aside_size + len(chunk))
        if self._aside_fd is None:
            flags = os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
            self._aside_fd = os.open(self._aside, flags, 0o644)
        self._aside_size += _write_all(self._aside_fd, chunk)

    def accept(self) -> None:
        """Append what was kept aside: it was verified, so a crash in between leaves verified bytes."""
        at = 0
        while self._aside_fd is not None and (chunk := os.pread(self._aside_fd, _COPY_BYTES, at)):
            self.size_bytes += _write_all(self._fd, chunk)
            at += len(chunk)
        self._aside_size = 0

    def head(self, count: int) -> bytes:
        """Return the first `count` bytes of the file, or all of a shorter one."""
        return os.pread(self._fd, count, 0)

    def sync(self) -> None:
        """Wait until the disk has every byte that counts."""
        crash_points.reach("upload.before-fsync")
        with full_disk_refused():
            os.fsync(self._fd)
        crash_points.reach("upload.after-fsync")

    def close(self) -> None:
        """Drop what was not accepted."""
        if self._aside_fd is not None:
            os.close(self._aside_fd)
            self._aside.unlink(missing_ok=True)

    def _check_room(self, more: int) -> None:
        if self.size_bytes + more > self._max_bytes:
            raise UploadTooLarge(
                f"The piece goes past the {self._max_bytes} bytes that the upload announced.",
                max_upload_bytes=self._max_bytes,
            )


class PieceStore:
    """Keep growing files as ``uploads/<id>`` under a root folder.

    Notes
    -----
    The size of the file is the only record of how far an upload has come. A lock on the file itself names
    its one writer, in whatever process; the kernel lets go of it when the writer dies.
    """

    def __init__(self, root: Path) -> None:
        self._folder = root.absolute() / "uploads"
        self._folder.mkdir(parents=True, exist_ok=True)

    def create(self, upload_id: str) -> None:
        """Make an empty file; it survives a crash from here on."""
        with full_disk_refused():
            fd = os.open(self.path(upload_id), os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
            os.close(fd)
            folder = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)

    def path(self, upload_id: str) -> Path:
        """Return where the file of an upload lies, whether it is there or not."""
        if not _ID.fullmatch(upload_id):
            msg = f"{upload_id!r} is no id of an upload"
            raise ValueError(msg)
        return self._folder / upload_id

    def size_bytes(self, upload_id: str) -> int:
        """Return how many bytes are safely on disk; they stay as many until the next piece begins.

        Raises
        ------
        UploadBusy
            If a piece is being written: where the next one would begin is not known yet.
        UploadExpired
            If the file is gone.
        """
        with self._opened(upload_id, os.O_RDONLY) as fd, full_disk_refused():
            _lock(fd, fcntl.LOCK_SH)
            os.fsync(fd)
            return os.fstat(fd).st_size

    @contextmanager
    def append(self, upload_id: str, *, max_bytes: int) -> Iterator[Appender]:
        """Give the one writer of a file; all that it wrote is on disk when the block ends, however it ends.

        Raises
        ------
        UploadBusy
            If somebody else is writing.
        UploadExpired
            If the file is gone.
        """
        with self._opened(upload_id, os.O_RDWR | os.O_APPEND) as fd:
            _lock(fd, fcntl.LOCK_EX)
            if os.fstat(fd).st_nlink == 0:
                raise _gone(upload_id)
            appender = Appender(fd, self._folder / f"{upload_id}.aside", max_bytes=max_bytes)
            try:
                yield appender
            finally:
                appender.close()
                appender.sync()

    def remove(self, upload_id: str) -> None:
        """Remove the file of an upload, if it is there."""
        self.path(upload_id).unlink(missing_ok=True)
        (self._folder / f"{upload_id}.aside").unlink(missing_ok=True)

    def sweep(
        self, is_wanted: Callable[[str], bool], *, now_s: float, older_than_s: float = 3600.0
    ) -> list[str]:
        """Remove old files whose uploads are not wanted any more, and return the ids.

        Parameters
        ----------
        is_wanted : callable
            Whether an unfinished upload with this id exists.
        now_s : float
            The present time, seconds since 1970.
        older_than_s : float, default 3600
            Younger files stay: their rows may be about to be written.
        """
        swept = []
        for path in sorted(self._folder.iterdir()):
            with suppress(FileNotFoundError):
                if now_s - path.stat().st_mtime >= older_than_s and not is_wanted(path.stem):
                    path.unlink()
                    swept.append(path.stem)
        return swept

    @contextmanager
    def _opened(self, upload_id: str, flags: int) -> Iterator[int]:
        try:
            fd = os.open(self.path(upload_id), flags | os.O_CLOEXEC)
        except FileNotFoundError:
            raise _gone(upload_id) from None
        try:
            yield fd
        finally:
            os.close(fd)


def _lock(fd: int, kind: int) -> None:
    try:
        fcntl.flock(fd, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UploadBusy(
            "Another request is writing to this upload; ask for its offset in a moment.",
            retry_after_s=_BUSY_FOR_S,
        ) from None


def _gone(upload_id: str) -> UploadExpired:
    return UploadExpired(f"What had come of the upload {upload_id} is gone; begin it again.")


def _write_all(fd: int, chunk: bytes) -> int:
    rest = memoryview(chunk)
    with full_disk_refused():
        while rest:
            rest = rest[os.write(fd, rest) :]
    return len(chunk)
