"""The child process that cuts a building model, as its parent sees it: asked, listened to, killed."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from service.domain.bounds import Bounds
from service.domain.errors import (
    DomainError,
    DrawingTooComplex,
    FileMalformed,
    NoWallsFound,
    PageNeeded,
    PageNotFound,
    UnsupportedMedia,
)

_LEAVES: dict[str, type[DomainError]] = {
    leaf.__name__: leaf
    for leaf in (DrawingTooComplex, FileMalformed, NoWallsFound, PageNeeded, PageNotFound, UnsupportedMedia)
}
_LISTEN_SECONDS = 0.2
_END_SECONDS = 10.0
_MOST_ANSWER = 256 << 20


def ask_kernel(
    path: Path,
    *,
    bounds: Bounds,
    cut_height_m: float,
    storey: str | None = None,
    page: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """Return the answer of `worker.formats.ifc_program` for a model.

    The geometry kernel is native code on an untrusted file: it may crash, hang, or take all memory, and takes
    only its own process with it. The process is killed when it takes too long, when `progress` raises, and by
    the kernel of the system when this process dies.

    Raises
    ------
    DrawingTooComplex
        If the model needs more time or memory than `bounds` give.
    FileMalformed
        If the model cannot be read, or the geometry kernel crashes on it.
    PageNeeded, PageNotFound
        If a storey has to be chosen, or the chosen one does not exist.
    NoWallsFound
        If the model has no wall.
    """
    request = {
        "path": str(path.resolve()),
        "parent": os.getpid(),
        "memory_bytes": bounds.max_model_memory_bytes,
        "cut_height_m": cut_height_m,
        "storey": storey,
        "page": page,
    }
    command = [sys.executable, "-m", "worker.formats.ifc_program"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as child:
        try:
            return _listen(child, request, path, bounds, progress or (lambda _share: None))
        finally:
            child.kill()


def _listen(
    child: subprocess.Popen[bytes],
    request: dict[str, Any],
    path: Path,
    bounds: Bounds,
    progress: Callable[[float], None],
) -> dict[str, Any]:
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        child.stdin.write(json.dumps(request).encode())
        child.stdin.close()
    except BrokenPipeError:
        pass
    until = time.monotonic() + bounds.max_model_seconds
    heard, share = bytearray(), 0.0
    while True:
        progress(share)
        if select.select([child.stdout], [], [], _LISTEN_SECONDS)[0]:
            some = os.read(child.stdout.fileno(), 1 << 20)
            if not some:
                return _answer(child, bytes(heard), path)
            heard += some
            if len(heard) > _MOST_ANSWER:
                raise DrawingTooComplex(f"The cut through {path.name} has more lines than are read.")
            share = _share(heard, share)
        if time.monotonic() > until and not heard:  # once the answer begins, the work is done
            raise DrawingTooComplex(
                f"{path.name} takes longer than {bounds.max_model_seconds:g} s to cut. Export the one storey "
                "that is needed, without furniture and fittings.",
            )


def _share(heard: bytearray, before: float) -> float:
    """Return the share done by the last whole progress line, and drop such lines from what was heard."""
    while heard.startswith(b"p ") and (end := heard.find(b"\n")) >= 0:
        before = float(heard[2:end])
        del heard[: end + 1]
    return before


def _answer(child: subprocess.Popen[bytes], heard: bytes, path: Path) -> dict[str, Any]:
    """Return the answer, if it is whole: then how the child ends, and how long it takes to, is its own."""
    if not heard.endswith(b"\n"):
        with suppress(subprocess.TimeoutExpired):
            child.wait(timeout=_END_SECONDS)
        child.kill()
        code = child.wait()
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        raise FileMalformed(
            f"The geometry kernel crashed on {path.name} ({how}): its geometry is damaged, or needs more "
            "memory than is given to one model. Export it again, the one storey that is needed."
        )
    answer: dict[str, Any] = json.loads(heard)
    if "refused" in answer:
        raise _LEAVES[answer["refused"]](f"{path.name} {answer['detail']}", **answer["members"])
    return answer
