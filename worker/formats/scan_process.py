"""The child process that reads a scan by native libraries, as its parent sees it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

from service.domain import errors
from service.domain.bounds import Bounds
from service.domain.reading_cost import reader_crashed
from worker.formats.scratch import scratch_folder
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.file_scan import FileScan, Statement
from worker.geometry.scan.mesh_sampling import Mesh


def load_apart(kind: str, path: Path, *, bounds: Bounds) -> FileScan:
    """Return a scan that `worker.formats.scan_program` reads in a process of its own.

    libE57, Pixar's USD and LASzip's port are native code on an untrusted file: they may crash, hang or take
    all memory, and take only their own process with them.

    Parameters
    ----------
    kind : str
        One of `worker.formats.scan_program.LOADERS`.
    path : Path
        The file.
    bounds : Bounds
        The most points, seconds and bytes of memory.

    Raises
    ------
    FileMalformed
        If the library needs more time than `bounds` give.
    ReaderCrashed
        If it crashes on the file.
    ReadingTooCostly
        If it needs more memory.
    Rejected
        As the kind's loader does.
    """
    with scratch_folder("groundplan-scan-") as folder:
        output = folder / "scan.npz"
        command = [
            sys.executable, "-m", "worker.formats.scan_program", kind, str(path.absolute()), str(output),
            str(bounds.max_points), str(bounds.max_scan_memory_bytes), str(os.getpid()),
        ]  # fmt: skip
        answer = json.loads(_answer(command, path, seconds=bounds.max_scan_seconds))
        return _loaded(answer, output, path=path, bounds=bounds)


def _answer(command: list[str], path: Path, *, seconds: float) -> bytes:
    """Return what the process answered, if it is whole: how and when the process ends then is its own."""
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=seconds, check=False, stdin=subprocess.DEVNULL
        )
    except subprocess.TimeoutExpired as late:
        if late.stdout is not None and late.stdout.endswith(b"\n"):
            return late.stdout
        raise errors.FileMalformed(
            f"Reading {path.name} takes longer than {seconds:g} s: it is damaged, or should be thinned "
            "before it is uploaded."
        ) from late
    if not done.stdout.endswith(b"\n"):
        code = done.returncode
        raise reader_crashed(path.name, how=signal.Signals(-code).name if code < 0 else f"exit code {code}")
    return done.stdout


def _loaded(answer: dict[str, object], output: Path, *, path: Path, bounds: Bounds) -> FileScan:
    if answer.get("refused") == MemoryError.__name__:
        raise errors.ReadingTooCostly(
            f"Reading {path.name} takes more than {bounds.max_scan_memory_bytes >> 20} MiB of memory. Thin "
            "the scan, or export it in parts; one that is small already is damaged.",
            limit="memory",
            memory_limit_bytes=bounds.max_scan_memory_bytes,
        )
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
