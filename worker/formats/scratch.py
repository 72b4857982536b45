"""Folders for files that live only while a file is read."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_NEXT_WRITE_BYTES = 1 << 20
"""What a buffered writer may ask for at once."""


@contextmanager
def scratch_folder(prefix: str) -> Iterator[Path]:
    """Give a folder that is gone when the block ends.

    Programs that write there tell a full disk in words of their own, or as a damaged file: where the block
    fails while the disk has no room, it is the disk that failed.

    Parameters
    ----------
    prefix : str
        How its name begins.

    Raises
    ------
    OSError
        With ENOSPC, if the block fails and the disk is full.
    """
    with tempfile.TemporaryDirectory(prefix=prefix) as folder:
        try:
            yield Path(folder)
        except Exception as error:
            found = os.statvfs(folder)
            if found.f_bavail * found.f_frsize < _NEXT_WRITE_BYTES:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), folder) from error
            raise
