"""The program that reads a scan by native libraries: on an untrusted file, so in a process of its own.

Its arguments are the kind, the file, where to write the arrays, the most points, the most bytes of memory and
its parent. It writes one JSON object to standard output, ``{"kind", "statement"}`` or
``{"refused": leaf, "detail": ..., "members": ...}``, or ``{"refused": "MemoryError"}``; it dies with its
parent.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib
import json
import os
import resource
import signal
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from service.domain.bounds import Bounds
from service.domain.errors import Rejected
from worker.geometry.scan.mesh_sampling import Mesh

LOADERS = {
    "las": ("worker.formats.las", "load_las"),
    "e57": ("worker.formats.e57", "load_e57"),
    "usd": ("worker.formats.usd", "load_usd"),
}
"""Kind to its loader: what is imported here is never imported by the parent."""

_PR_SET_PDEATHSIG = 1


def main() -> int:
    """Read one file; return 0 also where it is refused."""
    asked = _asked()
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    _limit(asked.memory_bytes, asked.parent)
    module, name = LOADERS[asked.kind]
    try:
        loaded = getattr(importlib.import_module(module), name)(
            asked.path, bounds=Bounds(max_points=asked.max_points)
        )
        if isinstance(loaded.surface, Mesh):
            np.savez(asked.output, vertices=loaded.surface.vertices, triangles=loaded.surface.triangles)
        else:
            np.savez(asked.output, points=loaded.surface.points)
        answer = {"kind": loaded.kind, "statement": asdict(loaded.statement)}
    except Rejected as refusal:
        answer = {"refused": type(refusal).__name__, "detail": refusal.detail, "members": refusal.members}
    except MemoryError:
        answer = {"refused": MemoryError.__name__}
    json.dump(answer, answers)
    answers.write("\n")
    answers.close()
    return 0


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The worker starts this for one scan.")
    parser.add_argument("kind", choices=sorted(LOADERS))
    parser.add_argument("path", type=Path, help="the scan")
    parser.add_argument("output", type=Path, help="where its arrays are written (.npz)")
    parser.add_argument("max_points", type=int)
    parser.add_argument("memory_bytes", type=int, help="the most memory that is taken")
    parser.add_argument("parent", type=int, help="process id: when it ends, so does this")
    return parser.parse_args()


def _limit(memory_bytes: int, parent: int) -> None:
    """Bound this process's memory, write no core, and die with the parent."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = memory_bytes if hard == resource.RLIM_INFINITY else min(memory_bytes, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            sys.exit(1)


if __name__ == "__main__":
    sys.exit(main())
