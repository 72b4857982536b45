"""The child process that reads a scan by native libraries, as its parent sees it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from service.domain import errors
from service.domain.bounds import Bounds
from worker.formats.scratch import scratch_folder
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.file_scan import FileScan, Statement
from worker.geometry.scan.mesh_sampling import Mesh


def load_apart(kind: str, path: Path, *, bounds: Bounds) -> FileScan:
    """Return a scan that `worker.formats.scan_kernel` reads in a process of its own.

    libE57, Pixar's USD and LASzip's port are native code on an untrusted file: they may crash, hang or take
    all memory, and take only their own process with them.

    Parameters
    ----------
    kind : str
        One of `worker.formats.scan_kernel.LOADERS`.
    path : Path
        The file.
    bounds : Bounds
        The most points, seconds and bytes of memory.

    Raises
    ------
    FileMalformed
        If the library crashes on the file, or needs more time than `bounds` give.
    ReadingTooCostly
        If it needs more memory.
    Rejected
        As the kind's loader does.
    """
    with scratch_folder("groundplan-scan-") as folder:
        output = folder / "scan.npz"
        command = [
            sys.executable, "-m", "worker.formats.scan_kernel", kind, str(path.absolute()), str(output),
            str(bounds.max_points), str(bounds.max_scan_memory_bytes), str(os.getpid()),
        ]  # fmt: skip
        return _loaded(json.loads(_answer(command, kind, seconds=bounds.max_scan_seconds)), output)


def _answer(command: list[str], kind: str, *, seconds: float) -> bytes:
    """Return what the process answered, if it is whole: how and when the process ends then is its own."""
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=seconds, check=False, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired as late:
        if late.stdout is not None and late.stdout.endswith(b"\n"):
            return late.stdout
        raise errors.FileMalformed(
            f"Reading the {kind.upper()} file takes longer than {seconds:g} s: it is damaged, or should be "
            "thinned before it is uploaded."
        ) from late
    if not done.stdout.endswith(b"\n"):
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
        raise errors.FileMalformed(
            f"The reader of {kind.upper()} files crashed on this one ({how}): it is damaged. Export it again."
        )
    return done.stdout


def _loaded(answer: dict[str, object], output: Path) -> FileScan:
    if "refused" in answer:
        leaf = getattr(errors, str(answer["refused"]))
        members = answer["members"]
        assert isinstance(members, dict)
        raise leaf(str(answer["detail"]), **members)
    said = answer["statement"]
    assert isinstance(said, dict)
    with np.load(output, allow_pickle=False) as arrays:
        if "points" in arrays:
            surface: PointCloud | Mesh = PointCloud.of(arrays["points"])
        else:
            surface = Mesh(arrays["vertices"], arrays["triangles"])
    return FileScan(surface, str(answer["kind"]), Statement(**said))
