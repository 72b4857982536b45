"""The protocol of a blob store: bytes named by their SHA-256, whole or not there at all."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol


@dataclass(frozen=True)
class Stored:
    """Hold the name and the size of bytes that are safely on disk."""

    sha256: str
    size_bytes: int


@dataclass(frozen=True)
class NewBlob:
    """Hold which file a blob was when it was made, so that a later one of the same name is told apart."""

    sha256: str
    inode: int
    made_ns: int


class StagedFile(Protocol):
    """A file being written; it becomes a blob by `keep`, or vanishes when its block ends."""

    path: Path

    @property
    def size_bytes(self) -> int:
        """Return how many bytes were written so far."""

    def write(self, chunk: bytes) -> None:
        """Append a chunk; its SHA-256 and size are taken on the way.

        Raises
        ------
        UploadTooLarge
            If the file would grow past its limit.
        StorageFull
            If the disk has no room.
        """

    def keep(self) -> Stored:
        """Make what was written a blob: fsync, rename, fsync the folder; the same bytes twice are one."""


class BlobStore(Protocol):
    """Keep blobs; a blob that exists never changes."""

    def stage(self, *, max_bytes: int) -> AbstractContextManager[StagedFile]:
        """Give a new staged file that takes at most `max_bytes`."""

    def adopt(self, path: Path, *, keep_source: bool = False) -> Stored:
        """Make an existing finished file a blob, and leave it in place if `keep_source`."""

    def path(self, sha256: str) -> Path:
        """Return the local path of a blob, for streaming and for readers that need a file.

        Raises
        ------
        ArtifactNotFound
            If there is no such blob.
        """

    def exists(self, sha256: str) -> bool:
        """Return whether the blob is there."""

    def is_empty(self) -> bool:
        """Return whether no blob is there at all."""

    def noting(self) -> AbstractContextManager[list[NewBlob]]:
        """Give a list that takes up every blob that the block makes and that was not there before."""

    def discard(self, made: NewBlob) -> None:
        """Remove a blob again, unless somebody has stored the same bytes since."""

    def sweep_staged(self, *, now_s: float, older_than_s: float = 60.0) -> list[Path]:
        """Remove the staged files of dead processes, and return them."""

    def sweep_orphans(
        self, is_known: Callable[[str], bool], *, now_s: float, older_than_s: float = 3600.0
    ) -> list[str]:
        """Remove old blobs that no row names, and return their SHA-256s."""

    def free_bytes(self) -> int:
        """Return how many bytes there is room for."""
