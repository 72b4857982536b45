"""A file system of 64 MiB that a test fills to the last byte, and processes that halt at a chosen instant."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from tests.patience import soon

SIZE_BYTES = 64 << 20
RESERVE_BYTES = 2 << 20
_BLOCK_BYTES = 1 << 20


@dataclass
class SmallDisk:
    """Hold where the small file system is mounted, for this process and all that it starts."""

    folder: Path

    @property
    def filler(self) -> Path:
        """Return the file that takes the room."""
        return self.folder / "filler"

    @property
    def free_bytes(self) -> int:
        """Return what is free."""
        found = os.statvfs(self.folder)
        return found.f_bavail * found.f_frsize

    def fill(self, *, leave_bytes: int = 0) -> None:
        """Take all room but `leave_bytes`."""
        with self.filler.open("ab", buffering=0) as file:
            while (left := self.free_bytes - leave_bytes) > 0:
                try:
                    file.write(bytes(min(_BLOCK_BYTES, left)))
                except OSError as error:
                    assert error.errno == errno.ENOSPC  # noqa: PT017 - others have taken it meanwhile
                    return

    def make_room(self) -> None:
        """Give all of it back."""
        self.filler.unlink(missing_ok=True)


@contextmanager
def mounted(folder: Path) -> Iterator[SmallDisk]:
    """Give a small file system at `folder`; only root of a mount namespace can."""
    folder.mkdir()
    words = ["-t", "tmpfs", "-o", f"size={SIZE_BYTES},mode=700", "groundplan", str(folder)]
    subprocess.run(["mount", *words], check=True)
    try:
        yield SmallDisk(folder)
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def order_halt(data_dir: Path, point: str) -> None:
    """Let the next process that passes the point stop there."""
    order = data_dir / "crash-at"
    order.with_suffix(".new").write_text(f"{point} halt", encoding="ascii")
    order.with_suffix(".new").replace(order)


def wait_halted(root_pid: int, data_dir: Path, *, is_over: Callable[[], bool]) -> psutil.Process:
    """Return the process, `root_pid` or one of those that it started, that has stopped at its point.

    Fail when the work `is_over`: then nobody will come by any more.
    """

    def halted() -> psutil.Process | None:
        assert not is_over(), "no process has come to the point"
        if (data_dir / "crash-at").exists():
            return None
        root = psutil.Process(root_pid)
        family = [root, *root.children(recursive=True)]
        return next((one for one in family if one.status() == psutil.STATUS_STOPPED), None)

    return soon(halted, "no process has come to the point")


def let_go(process: psutil.Process) -> None:
    """Let a stopped process go on."""
    process.send_signal(signal.SIGCONT)
