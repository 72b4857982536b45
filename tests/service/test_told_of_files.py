"""What a person is told of a file: by its name, in text that can be shown, whatever the file holds."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.settings import Settings
from tests import files
from tests.formats.cad_plans import draw_plan, new_drawing, saved
from tests.postgres import PostgresServer
from tests.server import ROOT, Server, environment, running
from tests.service.asking import a_map, ok

PATIENCE_S = 120.0
LISTS = ("/v1/drawings", "/v1/scans", "/v1/jobs", "/v1/audit", "/v1/maps", "/v1/stats")


@dataclass(frozen=True)
class Desk:
    """Hold a service with a worker, and a map to upload to."""

    client: httpx.Client
    map_id: str

    def told(self, purpose: str, name: str, content: bytes) -> dict[str, Any]:
        """Return the problem with which the reading of a file fails, after a look at every list."""
        sent = self.client.post(f"/v1/maps/{self.map_id}/{purpose}", files={"file": (name, content)})
        until = time.monotonic() + PATIENCE_S
        job = ok(sent, 202)["job"]
        while job["state"] not in {"succeeded", "failed"}:
            assert time.monotonic() < until, job
            time.sleep(0.05)
            job = ok(self.client.get(f"/v1/jobs/{job['id']}"))
        for path in (*LISTS, f"/v1/{purpose}/{job['subject_id']}", f"/v1/maps/{self.map_id}/{purpose}"):
            assert self.client.get(path).status_code == 200, path
        assert job["state"] == "failed", job
        problem: dict[str, Any] = job["problem"]
        return problem


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def desk(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    folder: Path = tmp_path_factory.mktemp("told")
    if request.param == "sqlite":
        with running(Settings(data_dir=folder)) as server:
            yield from _with_worker(server)
        return
    cluster: PostgresServer = request.getfixturevalue("postgres_server")
    with (
        cluster.database() as url,
        running(Settings(data_dir=folder, database_url=url)) as server,  # type: ignore[arg-type]
    ):
        yield from _with_worker(server)


def _with_worker(server: Server) -> Iterator[Desk]:
    worker = subprocess.Popen(
        [sys.executable, "-m", "worker"], cwd=ROOT, env=environment(server.settings), start_new_session=True
    )
    try:
        client = server.client(server.admin_key)
        yield Desk(client, a_map(client))
    finally:
        worker.send_signal(signal.SIGTERM)
        worker.wait(timeout=30)


def test_one_flipped_bit_that_is_no_text_poisons_nothing(desk: Desk, tmp_path: Path) -> None:
    doc = new_drawing()
    draw_plan(doc, 1000.0)
    whole = bytearray(saved(doc, tmp_path / "plan.dxf").read_bytes())
    whole[whole.index(b"$ACADMAINTVER")] ^= 0x80
    problem = desk.told("drawings", "hall 2.dxf", bytes(whole))
    assert problem["detail"].startswith("hall 2.dxf breaks the rules of DXF")
    assert '"\N{REPLACEMENT CHARACTER}ACADMAINTVER"' in problem["detail"]


CUT = {
    "plan.png": ("drawings", files.png(400, 300)[:-5000]),
    "plan.bmp": ("drawings", b"BM" + (5000).to_bytes(4, "little") + bytes(48)),
    "plan.tif": ("drawings", b"II*\0" + (8).to_bytes(4, "little") + bytes(40)),
    "plan.dxf": ("drawings", b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n"),
    "plan.dwg": ("drawings", b"AC1032" + bytes(200)),
    "plan.svg": ("drawings", b'<?xml version="1.0"?><svg xmlns="http://www.w3.org/2000/svg"><g>'),
    "plan.ifc": ("drawings", b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=IFCWALL("),
    "plan.pgm": ("drawings", b"P5\n400 300\n255\n" + bytes(100)),
    "map.yaml": ("drawings", b"image: a.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"),
    "building.yaml": ("drawings", b"levels:\n  L1:\n    walls: []\n"),
}


@pytest.mark.parametrize("name", CUT)
def test_a_problem_calls_the_file_by_its_name(desk: Desk, name: str) -> None:
    purpose, content = CUT[name]
    shown = f"Halle Süd {name}"
    problem = desk.told(purpose, shown, content)
    assert shown in problem["detail"], problem


UNNAMED = {
    "a.pdf": ("drawings", b"%PDF-1.7\n1 0 obj"),
    "a.ply": ("scans", files.ply(files.room())[:-1000]),
    "a.las": ("scans", b"LASF" + bytes(400)),
    "a.e57": ("scans", b"ASTM-E57" + bytes(400)),
    "a.usda": ("scans", b"#usda 1.0\n(\n"),
    "a.glb": ("scans", b"glTF" + (2).to_bytes(4, "little") + bytes(40)),
    "a.obj": ("scans", b"v 1 2 3\nf 1 2 9\n"),
    "a.stl": ("scans", b"solid a\nfacet normal 0 0 1\n"),
    "a.csv": ("scans", b"x,y,z\n1,2,3\n1,2\n"),
}


@pytest.mark.parametrize("name", UNNAMED)
def test_no_problem_calls_a_file_by_its_digest(desk: Desk, name: str) -> None:
    purpose, content = UNNAMED[name]
    sent = desk.client.post(f"/v1/maps/{desk.map_id}/{purpose}", files={"file": (name, content)})
    told = sent.json() if sent.status_code == 422 else desk.told(purpose, name, content)
    assert not re.search(r"[0-9a-f]{40}", told["detail"]), json.dumps(told)


@pytest.mark.parametrize("name", ["..", "a/b.dxf", "図面" * 120 + ".dxf", "-rf.dxf", "x\n.dxf"])
def test_a_strange_name_is_only_a_name(desk: Desk, name: str) -> None:
    problem = desk.told("drawings", name, CUT["plan.dxf"][1] + name.encode())
    assert problem["type"].rpartition("/")[2] == "file-truncated", problem
