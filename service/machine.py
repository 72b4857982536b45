"""How much memory there is for this process: the machine's, or what its container or unit may take."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

_GROUPS = Path("/sys/fs/cgroup")
_OWN = Path("/proc/self/cgroup")
_LIMITS = (("", "memory.max"), ("memory", "memory.limit_in_bytes"))
"""Where the two versions of control groups keep limits of memory: a folder, and a file in each group."""


def memory_bytes(*, groups: Path = _GROUPS, own: Path = _OWN) -> int:
    """Return the least of the machine's memory and the limits of the control groups that hold this process.

    Parameters
    ----------
    groups : Path
        Where the kernel shows control groups.
    own : Path
        Where it tells which of them hold this process.
    """
    found = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    names = [Path("/")]
    with suppress(OSError):
        names += [Path(line.split(":", 2)[2]) for line in own.read_text(encoding="utf-8").splitlines()]
    for group in {above for name in names for above in (name, *name.parents)}:
        for folder, file in _LIMITS:
            with suppress(OSError, ValueError):  # "max" is no limit
                found.append(
                    int((groups / folder / str(group).lstrip("/") / file).read_text(encoding="ascii"))
                )
    return min(found)
