"""The demonstration, as a person runs it."""

from __future__ import annotations

import hashlib
import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.factories import synthetic_hall
from worker.formats.pcd import read_pcd
from worker.geometry.cloud.point_cloud import Label

ROOT = Path(__file__).resolve().parents[2]


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "demo", *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


@pytest.mark.slow
def test_the_demo_ends_with_revision_2_published_and_its_download_verified(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    ran = _run("--no-wait", "--seed", "1", "--output", str(folder))
    assert ran.returncode == 0, ran.stdout + ran.stderr
    told = re.findall(r"told: revision (\d)", ran.stdout)
    assert told == ["1", "2"]
    verified = re.findall(r"SHA-256 ([0-9a-f]{64}) = ETag = artifact list", ran.stdout)
    files = [folder / f"point-cloud-revision-{n}.pcd" for n in (1, 2)]
    assert verified == [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    machine = synthetic_hall(1).new_machine
    before, after = (machine.holds(read_pcd(file).points, margin=0.05).sum() for file in files)
    assert before == 0
    assert after > 1000
    added = read_pcd(files[1])
    layer = added.points[added.labels == Label.LAYER]
    assert machine.holds(layer, margin=0.05).mean() > 0.8, "only what the map does not explain is compounded"
    assert (folder / "preview-revision-2.png").read_bytes().startswith(b"\x89PNG")


def test_the_demo_refuses_a_folder_that_has_data_already(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    ran = _run("--no-wait", "--output", str(tmp_path))
    assert ran.returncode == 1
    assert "exists already" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_the_demo_says_why_the_service_did_not_start(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        ran = _run("--no-wait", "--output", str(tmp_path), "--port", str(port))
    assert ran.returncode == 1
    assert "groundplan up ended with status" in ran.stderr
    assert "Traceback" not in ran.stderr
