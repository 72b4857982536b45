"""A delta between two clouds of 1 GB: made, and decoded by the documented command and by the client."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.server import ROOT

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(900)]

POINTS = 62_500_000
MOVED, ADDED = 2_000_000, 2_000_000
RECORD = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("label", "<u4")])

MAKE = """
import sys; from pathlib import Path; from worker.formats.delta import write_delta
old, new, delta = map(Path, sys.argv[1:]); write_delta(delta, old=old, new=new)
"""
DECODE = """
import sys; from pathlib import Path; sys.path.insert(0, "client"); import groundplan_robot as client
old, delta, fresh = map(Path, sys.argv[1:]); client.decode(old, delta, fresh)
"""
DECODE_BY_PROGRAM = DECODE.replace("old, delta", "client.find_zstd = lambda: 'zstd'; old, delta", 1)


def measured(command: list[object], folder: Path) -> tuple[float, float]:
    """Return how long a command took [s], and the most memory that it and its children held [GB]."""
    meter = (
        "import resource, subprocess, sys; done = subprocess.run(sys.argv[1:]).returncode;"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss); sys.exit(done)"
    )
    begun = time.perf_counter()
    told = subprocess.run(
        [sys.executable, "-c", meter, *map(str, command)], cwd=folder, check=True, capture_output=True
    )
    return time.perf_counter() - begun, int(told.stdout) * 1024 / 1e9


def sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def test_two_clouds_of_1_gb(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    cloud = np.zeros(POINTS, RECORD)
    for axis in "xyz":
        cloud[axis] = np.round(rng.uniform(0, 200, POINTS), 3)
    old, new, delta, fresh = (tmp_path / name for name in ("old.pcd", "new.pcd", "delta.zst", "fresh.pcd"))
    old.write_bytes(cloud.tobytes())
    cloud["x"][1000 : 1000 + MOVED] += 1.5
    new.write_bytes(cloud.tobytes() + rng.permutation(cloud[:ADDED]).tobytes())
    assert old.stat().st_size == 1_000_000_000
    rows = {"made": measured([sys.executable, "-c", MAKE, old, new, delta], ROOT)}
    documented = ["zstd", "-dqf", "--long=31", f"--patch-from={old}", delta, "-o", fresh]
    for name, command in {
        "documented command": documented,
        "client, zstd program": [sys.executable, "-c", DECODE_BY_PROGRAM, old, delta, fresh],
        "client, zstd module": [sys.executable, "-c", DECODE, old, delta, fresh],
    }.items():
        fresh.unlink(missing_ok=True)
        rows[name] = measured(command, ROOT)
        assert sha256(fresh) == sha256(new), name
    print(f"\n{old.stat().st_size / 1e9:.2f} GB to {new.stat().st_size / 1e9:.2f} GB:")
    print(f"delta {delta.stat().st_size / 1e6:.1f} MB = {delta.stat().st_size / new.stat().st_size:.1%}")
    for name, (took_s, held_gb) in rows.items():
        print(f"{name:22} {took_s:6.1f} s {held_gb:5.2f} GB")
