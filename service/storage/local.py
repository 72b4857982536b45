"""Blobs in a folder of this machine (or of a volume that all processes share)."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from service import crash_points
from service.domain.errors import ArtifactNotFound, UploadTooLarge
from service.storage.blobs import NewBlob, Stored
from service.storage.room import full_disk_refused

_CHUNK_BYTES = 1 << 20
_HEX = frozenset("0123456789abcdef")
_noted: ContextVar[list[NewBlob] | None] = ContextVar("noted", default=None)


class LocalStagedFile:
    """A file being written under ``blobs/.tmp/``; the lock on it says that a living process owns it."""

    def __init__(self, store: LocalBlobStore, path: Path, *, max_bytes: int) -> None:
        self.path = path
        self._store = store
        self._max_bytes = max_bytes
        self._size = 0
        self._sha256 = hashlib.sha256()
        self._kept = False
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        fcntl.flock(self._fd, fcntl.LOCK_EX)

    @property
    def size_bytes(self) -> int:
        """Return how many bytes were written so far."""
        return self._size

    def write(self, chunk: bytes) -> None:
        """Append a chunk; its SHA-256 and size are taken on the way.

        Raises
        ------
        UploadTooLarge
            If the file would grow past its limit.
        StorageFull
            If the disk has no room.
        ValueError
            If the file was kept already.
        """
        if self._kept:
            msg = "a file that was kept takes no more bytes"
            raise ValueError(msg)
        if self._size + len(chunk) > self._max_bytes:
            raise UploadTooLarge(
                f"The upload is larger than the {self._max_bytes} bytes that this server takes.",
                max_upload_bytes=self._max_bytes,
            )
        rest = memoryview(chunk)
        with full_disk_refused():
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        self._sha256.update(chunk)
        self._size += len(chunk)

    def keep(self) -> Stored:
        """Make what was written a blob: fsync, rename, fsync the folder. The same bytes twice are one blob.

        Raises
        ------
        StorageFull
            If the disk has no room.
        """
        if self._kept:
            msg = "a staged file is kept once"
            raise ValueError(msg)
        stored = Stored(self._sha256.hexdigest(), self._size)
        self._store.settle(self.path, self._fd, stored)
        self._kept = True
        return stored

    def close(self) -> None:
        """Let go of the file, and remove it unless it was kept."""
        if not self._kept:
            self.path.unlink(missing_ok=True)
        os.close(self._fd)


class LocalBlobStore:
    """Keep blobs as ``blobs/ab/<sha256>`` under a root, and what is being written beside them.

    Parameters
    ----------
    root : Path
        Made if it is not there. Every process of one installation has to see the same folder.

    Notes
    -----
    What is being written lies in ``blobs/.tmp/``: on one file system with the blobs, also where these have
    a volume of their own (older versions wrote in ``tmp/`` beside them). A blob appears by a rename after an
    fsync, so it is whole or not there, whatever kills the process or the machine. Settling and sweeping take
    one lock (``blobs/.lock``), held for a rename or an unlink alone: a blob that is stored again while it is
    being swept as an orphan survives.
    """

    def __init__(self, root: Path) -> None:
        self._blobs = root.absolute() / "blobs"
        self._tmp = self._blobs / ".tmp"
        self._older_tmp = root.absolute() / "tmp"
        for folder in (self._blobs, self._tmp):
            folder.mkdir(parents=True, exist_ok=True)

    @contextmanager
    def stage(self, *, max_bytes: int) -> Iterator[LocalStagedFile]:
        """Give a new staged file that takes at most `max_bytes`; it is removed at the end unless kept.

        Raises
        ------
        StorageFull
            If the disk has no room for one more file.
        """
        with full_disk_refused():
            staged = LocalStagedFile(self, self._new_tmp(), max_bytes=max_bytes)
        try:
            yield staged
        finally:
            staged.close()

    def adopt(self, path: Path, *, keep_source: bool = False) -> Stored:
        """Make an existing finished file a blob.

        Parameters
        ----------
        path : Path
            A file that nobody writes any more. It is moved where the file system allows, else copied.
        keep_source : bool, default False
            Leave `path` in place as a second name of the same bytes (a hard link where possible).

        Raises
        ------
        StorageFull
            If the disk has no room.
        """
        with full_disk_refused():
            name = self._new_tmp()
            try:
                _bring(path, name, keep_source=keep_source)
                fd = os.open(name, os.O_RDONLY | os.O_CLOEXEC)
                try:
                    with suppress(BlockingIOError):  # then the caller holds it, which protects it as well
                        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    stored = _measure(fd)
                    self.settle(name, fd, stored)
                finally:
                    os.close(fd)
            finally:
                name.unlink(missing_ok=True)
        return stored

    def path(self, sha256: str) -> Path:
        """Return the local path of a blob, for streaming and for readers that need a file.

        Raises
        ------
        ArtifactNotFound
            If there is no such blob.
        """
        place = self._place(sha256)
        if not place.is_file():
            raise ArtifactNotFound(f"There are no bytes with the SHA-256 {sha256}.", sha256=sha256)
        return place

    def exists(self, sha256: str) -> bool:
        """Return whether the blob is there."""
        return self._place(sha256).is_file()

    def is_empty(self) -> bool:
        """Return whether no blob is there at all."""
        return next(self._blobs.glob("??/*"), None) is None

    def free_bytes(self) -> int:
        """Return how many bytes the disk has room for."""
        return shutil.disk_usage(self._blobs).free

    def settle(self, path: Path, fd: int, stored: Stored) -> None:
        """Rename a complete file, open as `fd`, to its blob's name so that it survives a power cut."""
        place = self._place(stored.sha256)
        with full_disk_refused():
            crash_points.reach("blob.before-fsync")
            os.fchmod(fd, 0o444)
            os.fsync(fd)
            if not place.parent.is_dir():
                place.parent.mkdir(exist_ok=True)
                _sync_folder(self._blobs)
            crash_points.reach("blob.before-rename")
            with self._locked():
                is_new = not place.exists()
                os.utime(fd)
                path.replace(place)
            _note(fd, stored.sha256, is_new=is_new)
            crash_points.reach("blob.after-rename")
            _sync_folder(place.parent)

    @contextmanager
    def noting(self) -> Iterator[list[NewBlob]]:
        """Give a list that takes up every blob that the block makes and that was not there before."""
        noted: list[NewBlob] = []
        token = _noted.set(noted)
        try:
            yield noted
        finally:
            _noted.reset(token)

    def discard(self, made: NewBlob) -> None:
        """Remove a blob again, unless somebody has stored the same bytes since: then it is another file."""
        place = self._place(made.sha256)
        with self._locked(), suppress(FileNotFoundError):
            found = place.stat()
            if (found.st_ino, found.st_mtime_ns) == (made.inode, made.made_ns):
                place.unlink()

    def sweep_staged(self, *, now_s: float, older_than_s: float = 60.0) -> list[Path]:
        """Remove what dead processes left under ``blobs/.tmp/`` or the older ``tmp/``, and return it.

        Parameters
        ----------
        now_s : float
            The present time, seconds since 1970.
        older_than_s : float, default 60
            Younger files stay even when no process holds them: one may be just opening them. The age is
            that of the last change of the name or the bytes.
        """
        swept = []
        for path in sorted([*self._tmp.glob("*"), *self._older_tmp.glob("*")]):
            with suppress(FileNotFoundError):
                if now_s - path.stat().st_ctime >= older_than_s and not _is_held(path):
                    path.unlink()
                    swept.append(path)
        return swept

    def sweep_orphans(
        self, is_known: Callable[[str], bool], *, now_s: float, older_than_s: float = 3600.0
    ) -> list[str]:
        """Remove blobs that no row names, and return their SHA-256s.

        Parameters
        ----------
        is_known : callable
            Whether a row names the blob; asked only for blobs that are old enough.
        now_s : float
            The present time, seconds since 1970.
        older_than_s : float, default 3600
            Younger blobs stay: their rows may be about to be written (bytes first, rows second).
        """
        swept = []
        for place in sorted(self._blobs.glob("??/*")):
            if not _is_old(place, now_s, older_than_s) or is_known(place.name):
                continue
            with self._locked():
                if _is_old(place, now_s, older_than_s):
                    place.unlink(missing_ok=True)
                    swept.append(place.name)
        return swept

    def _place(self, sha256: str) -> Path:
        if len(sha256) != 64 or not _HEX.issuperset(sha256):
            msg = f"a blob is named by 64 small hexadecimal digits, not {sha256!r}"
            raise ValueError(msg)
        return self._blobs / sha256[:2] / sha256

    def _new_tmp(self) -> Path:
        return self._tmp / secrets.token_hex(16)

    @contextmanager
    def _locked(self) -> Iterator[None]:
        fd = os.open(self._blobs / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX)
            yield
        finally:
            os.close(fd)


def _note(fd: int, sha256: str, *, is_new: bool) -> None:
    noted = _noted.get()
    if is_new and noted is not None:
        made = os.fstat(fd)
        noted.append(NewBlob(sha256, made.st_ino, made.st_mtime_ns))


def _bring(path: Path, name: Path, *, keep_source: bool) -> None:
    """Give the file `path` the name `name`: moved or linked within a file system, else copied."""
    try:
        if keep_source:
            name.hardlink_to(path)
        else:
            path.rename(name)
    except OSError as error:
        if error.errno not in {errno.EXDEV, errno.EPERM, errno.EMLINK, errno.ENOTSUP}:
            raise
        shutil.copyfile(path, name)
        if not keep_source:
            path.unlink()


def _measure(fd: int) -> Stored:
    sha256, size = hashlib.sha256(), 0
    while chunk := os.pread(fd, _CHUNK_BYTES, size):
        sha256.update(chunk)
        size += len(chunk)
    return Stored(sha256.hexdigest(), size)


def _sync_folder(folder: Path) -> None:
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def _is_old(path: Path, now_s: float, older_than_s: float) -> bool:
    try:
        return now_s - path.stat().st_mtime >= older_than_s
    except FileNotFoundError:
        return False


def _is_held(path: Path) -> bool:
    fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    else:
        return False
    finally:
        os.close(fd)
