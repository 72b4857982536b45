"""The README's two tours, line by line as they stand there."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from demo.running import groundplan_up
from demo.sheet import drawing_png
from demo.survey import ply_bytes, scan_of_new_machine
from tests.factories import synthetic_hall
from worker.formats.pcd import read_pcd

README = Path(__file__).resolve().parents[2] / "README.md"
JOB_S = 120.0


def _tour(name: str) -> list[str]:
    block = re.search(rf"<!-- tour: {name} -->\n```sh\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert block is not None
    return block[1].splitlines()


def _shell(line: str, folder: Path, **variables: str) -> str:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euc", line],
        cwd=folder,
        env=os.environ | {"PATH": path} | variables,
        capture_output=True,
        text=True,
        timeout=JOB_S,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    hall = synthetic_hall(1)
    (tmp_path / "drawing.png").write_bytes(drawing_png(hall))
    (tmp_path / "scan.ply").write_bytes(ply_bytes(scan_of_new_machine(hall, seed=1).cloud.points))
    return tmp_path


@pytest.mark.slow
def test_the_tour_by_command_line(folder: Path) -> None:
    for line in _tour("command line"):
        _shell(line, folder)
    placement = json.loads((folder / "placed" / "placement.json").read_text())
    truth = scan_of_new_machine(synthetic_hall(1), seed=1).T_map_scan
    assert placement["verdict"] == "accepted", placement["reasons"]
    found = [row[3] for row in placement["T_map_scan"][:3]]
    assert found == pytest.approx(list(truth.translation), abs=0.1)
    merged, before = read_pcd(folder / "merged.pcd"), read_pcd(folder / "hall" / "point-cloud.pcd")
    assert len(merged.points) > len(before.points)


class _Tour:
    """Run the lines of the tour by curl, keeping the ids of the answers as a person would."""

    def __init__(self, folder: Path, *, server: str, key: str) -> None:
        self.folder = folder
        self.known = {"SERVER": server, "KEY": key, "AUTH": f"Authorization: Bearer {key}"}

    def curl(self, line: str) -> dict[str, Any]:
        """Return the JSON answer of a line, or nothing where it saves a file."""
        said = _shell(line.replace("curl ", "curl -sS --fail-with-body ", 1), self.folder, **self.known)
        answer: dict[str, Any] = json.loads(said) if said else {}
        for name in ("drawing", "scan", "placement", "job"):
            if isinstance(answer.get(name), dict):
                self.known[name.upper()] = answer[name]["id"]
        if "site" in answer:
            self.known["MAP"] = answer["id"]
        if isinstance(answer.get("job"), dict):
            self._wait()
        return answer

    def _wait(self) -> None:
        deadline = time.monotonic() + JOB_S
        while True:
            job = json.loads(_shell('curl -sS -H "$AUTH" $SERVER/v1/jobs/$JOB', self.folder, **self.known))
            if job["state"] == "succeeded":
                return
            assert job["state"] in {"queued", "running"}, job
            assert time.monotonic() < deadline, job
            time.sleep(0.1)


@pytest.mark.slow
def test_the_tour_by_curl(folder: Path) -> None:
    if shutil.which("curl") is None:
        pytest.skip("curl is not installed: run tools/setup --tests")
    first, *lines = _tour("curl")
    assert first == 'AUTH="Authorization: Bearer $KEY"'
    with groundplan_up(folder) as running:
        tour = _Tour(folder, server=running.address, key=running.admin_key)
        answers = [tour.curl(line) for line in lines]
        shown = next(
            a for a, line in zip(answers, lines, strict=True) if line.endswith("/placements/$PLACEMENT")
        )
        assert shown["verdict"] == "accepted", shown["reasons"]
        listed = tour.curl('curl -H "$AUTH" $SERVER/v1/maps/$MAP/revisions/2/artifacts')["items"]
    told = {item["path"]: item["sha256"] for item in listed}
    saved = hashlib.sha256((folder / "point-cloud.pcd").read_bytes()).hexdigest()
    assert saved == told["point-cloud.pcd"]
