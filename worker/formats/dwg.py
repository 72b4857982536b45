"""DWG drawings to linework: converted to DXF by a process with limits, then read as DXF."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.errors import (
    DrawingTooComplex,
    FileMalformed,
    FileTruncated,
    UnsupportedMedia,
    UploadTooLarge,
)
from worker.formats import dwg_program
from worker.formats.dxf import load_dxf
from worker.formats.scratch import scratch_folder
from worker.geometry.drawing.linework.linework import Linework

Tell = Callable[[str, float], None]

_POLL_S = 0.2
_LEAST_BYTES = 128


def load_dwg(path: Path, *, bounds: Bounds, tell: Tell | None = None) -> Linework:
    """Return the model space of a DWG drawing as linework, as `load_dxf` does.

    Parameters
    ----------
    path : Path
        DWG of release 13 or later.
    bounds : Bounds
        The most that is read, and how long the conversion may take.
    tell : callable, optional
        Told the stage and the share done; what it raises ends the work, and the conversion with it.

    Returns
    -------
    Linework
        In drawing units.

    Raises
    ------
    UploadTooLarge
        If the file is larger than is read.
    FileTruncated
        If the file is shorter than its own header.
    FileMalformed
        If it cannot be converted.
    UnsupportedMedia
        If it is of a release that is not read.
    DrawingTooComplex
        If converting it takes too long or too much memory, or the drawing is too large.
    FileEmpty, NotFinite
        As `load_dxf`.
    """
    size = path.stat().st_size
    if size > bounds.max_dxf_bytes:
        raise UploadTooLarge(
            f"{path.name} has {size >> 20} MiB; at most {bounds.max_dxf_bytes >> 20} MiB are read.",
            max_upload_bytes=bounds.max_dxf_bytes,
        )
    if size < _LEAST_BYTES:
        raise FileTruncated(f"{path.name} has only {size} bytes: the copy or the upload was cut short.")
    with scratch_folder("groundplan-dwg-") as folder:
        target = folder / path.name
        _convert(path, target, bounds=bounds, tell=tell or (lambda _stage, _share: None))
        return load_dxf(target, bounds=replace(bounds, max_dxf_bytes=bounds.max_dxf_bytes * 2), tell=tell)


def _convert(path: Path, target: Path, *, bounds: Bounds, tell: Tell) -> None:
    limits = (bounds.max_dwg_memory_bytes, bounds.max_dwg_seconds, bounds.max_dxf_bytes)
    command = [sys.executable, "-I", dwg_program.__file__, str(path.resolve()), str(target)]
    with subprocess.Popen(
        [*command, *(str(v) for v in limits)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            for n in range(int(2 * bounds.max_dwg_seconds / _POLL_S)):
                tell("convert", min(0.25, n * 0.01))
                try:
                    _, said = process.communicate(timeout=_POLL_S)
                    break
                except subprocess.TimeoutExpired:
                    continue
            else:
                raise _too_complex(path, bounds)
        finally:
            if process.poll() is None:
                process.kill()
    _judge(path, process.returncode, said.decode(errors="replace").strip(), bounds)


def _judge(path: Path, status: int, said: str, bounds: Bounds) -> None:
    if status == 0:
        return
    if status in (dwg_program.TOO_COMPLEX, -24):
        raise _too_complex(path, bounds)
    if status == dwg_program.UNSUPPORTED:
        raise UnsupportedMedia(f"{path.name} is a DWG of a kind that is not read ({said}): save it as DXF.")
    reason = said.splitlines()[-1][:200] if said else f"the reader died with status {status}"
    raise FileMalformed(
        f"{path.name} cannot be read as DWG: {reason}. It may be cut short or damaged: open it in a CAD "
        "program, repair it (RECOVER), and save it again or as DXF."
    )


def _too_complex(path: Path, bounds: Bounds) -> DrawingTooComplex:
    return DrawingTooComplex(
        f"{path.name} needs more than {bounds.max_dwg_seconds} s or {bounds.max_dwg_memory_bytes >> 20} MiB "
        "to be read. Purge it, or save the one floor that is needed.",
        max_seconds=bounds.max_dwg_seconds,
    )
