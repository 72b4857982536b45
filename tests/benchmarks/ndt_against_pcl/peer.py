"""PCL as a program: built from the source beside this file, asked by its command line."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent


class NoPcl(RuntimeError):
    """PCL is not installed: apt-get install --no-install-recommends libpcl-dev g++."""


def compile_peer(folder: Path) -> Path:
    """Return the program built from `pcl_ndt.cpp` against the PCL of this system.

    Raises
    ------
    NoPcl
        If it has none.
    """
    headers = sorted(Path("/usr/include").glob("pcl-*"))
    if not headers:
        raise NoPcl(NoPcl.__doc__)
    libraries = ["registration", "search", "kdtree", "filters", "io", "common"]
    program = folder / "pcl_ndt"
    subprocess.run(
        ["g++", "-std=c++17", "-O3", "-DNDEBUG", f"-I{headers[-1]}", "-I/usr/include/eigen3",
         str(HERE / "pcl_ndt.cpp"), "-o", str(program), *[f"-lpcl_{name}" for name in libraries],
         "-lflann", "-llz4", "-lboost_system"],
        check=True,
    )  # fmt: skip
    return program


def ask(program: Path, *words: object) -> dict[str, Any]:
    """Return what the peer printed."""
    run = subprocess.run([str(program), *map(str, words)], check=True, capture_output=True, text=True)
    answer: dict[str, Any] = json.loads(run.stdout)
    return answer
