"""A disk that is full at each stage of each upload and job, in a mount namespace of the test's own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

_HERE = Path(__file__).parent
_WAYS = (["unshare", "--mount"], ["unshare", "--map-root-user", "--mount"])

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]


def _way_in() -> list[str]:
    """Return the command in front of another that gives it a mount namespace; skip where none can be had."""
    for way in _WAYS if shutil.which("unshare") and shutil.which("mount") else ():
        probe = [*way, "mount", "-t", "tmpfs", "groundplan", "/mnt"]
        if subprocess.run(probe, check=False, capture_output=True).returncode == 0:
            return way
    pytest.skip("this user can neither mount here nor make a namespace of its own: no small disk to fill")


@pytest.mark.parametrize("stages", [pytest.param("some"), pytest.param("all", marks=pytest.mark.full_disk)])
@pytest.mark.parametrize("story", ["upload_stages.py", "reads.py", "job_stages.py"])
def test_a_full_disk_is_told_and_nothing_is_lost(story: str, stages: str, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider"]
    words += [f"--basetemp={tmp_path / 'in'}", "--timeout=600"]
    done = subprocess.run(
        [*_way_in(), *words, str(_HERE / story)],
        env={**os.environ, "GROUNDPLAN_TEST_STAGES": stages},
        check=False,
        capture_output=True,
        text=True,
    )
    print(done.stdout)  # noqa: T201 - the table of stages and outcomes
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
