"""A real service with a real worker that files are pushed through, and all that it answers afterwards."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx

from service.settings import Settings
from tests.hostile.known import READING
from tests.server import ROOT, Server, environment, running

_FINAL = {"succeeded", "failed", "cancelled"}
_PARAMETER = re.compile(r"\{(\w+)\}")
_OF_A_FILE = {"map_id", "drawing_id", "scan_id", "job_id"}
_PATIENCE_S = 600.0


@dataclass(frozen=True)
class Ending:
    """Hold how an upload ended: as a reading or a problem, and what was wrong with what the service said."""

    end: str
    detail: str = ""
    findings: tuple[str, ...] = ()
    ids: dict[str, str] = field(default_factory=dict)


class Plant:
    """Push files through an upload and a job, and ask for every list and each thing.

    Parameters
    ----------
    server : Server
        A running service; its worker runs beside it.
    client : httpx.Client
        With a key that may see everything.
    """

    def __init__(self, server: Server, client: httpx.Client) -> None:
        self.server = server
        self.client = client
        made = client.post("/v1/maps", json={"site": "plant", "name": "hostile"})
        self.map_id: str = made.json()["id"]
        self._gets = [
            (path, told["get"])
            for path, told in client.get("/openapi.json").json()["paths"].items()
            if "get" in told
        ]

    def push(self, collection: str, content: bytes, *, name: str) -> Ending:
        """Return how a file ended: refused at once, or as its job."""
        answer = self.client.post(f"/v1/maps/{self.map_id}/{collection}", files={"file": (name, content)})
        if answer.status_code != 202:
            assert answer.headers["content-type"] == "application/problem+json", answer.text
            assert 400 <= answer.status_code < 500, answer.text
            return _problem(answer.json(), {"map_id": self.map_id})
        said = answer.json()
        thing = collection.removesuffix("s")
        ids = {"map_id": self.map_id, "job_id": said["job"]["id"], f"{thing}_id": said[thing]["id"]}
        job = self._ended(ids["job_id"])
        if job["state"] != "succeeded":
            return _problem(job["problem"], ids)
        reading = self.client.get(f"/v1/{collection}/{ids[f'{thing}_id']}").json()["reading"]
        return Ending(READING, findings=tuple(f["code"] for f in reading["findings"]), ids=ids)

    def _ended(self, job_id: str) -> dict[str, Any]:
        until = time.monotonic() + _PATIENCE_S
        while True:
            job: dict[str, Any] = self.client.get(f"/v1/jobs/{job_id}").json()
            if job["state"] in _FINAL:
                return job
            assert time.monotonic() < until, job
            time.sleep(0.02)

    def unwell(self, ids: dict[str, str]) -> list[str]:
        """Return which lists, and which things of an upload by their ids, do not answer 200 with JSON."""
        out = []
        for path, told in self._gets:
            needed = set(_PARAMETER.findall(path))
            if not needed <= ids.keys() or not _is_list_or_thing(path, told):
                continue
            answer = self.client.get(path.format(**ids))
            if answer.status_code != 200:
                out.append(f"GET {path}: {answer.status_code} {answer.text[:200]}")
            else:
                answer.json()
        return out


def _is_list_or_thing(path: str, told: dict[str, Any]) -> bool:
    schema = told["responses"]["200"].get("content", {}).get("application/json", {}).get("schema", {})
    is_page = "/Page_" in schema.get("$ref", "")
    return is_page or path.endswith(tuple(f"{{{name}}}" for name in _OF_A_FILE))


def _problem(problem: dict[str, Any], ids: dict[str, str]) -> Ending:
    assert problem["title"], problem
    assert problem["detail"], problem
    return Ending(problem["type"].rpartition("/")[2], problem["detail"], ids=ids)


@contextmanager
def working(settings: Settings) -> Iterator[Plant]:
    """Run a service and a worker until the block ends."""
    with running(settings) as server, (settings.data_dir / "worker.log").open("ab") as log:
        worker = subprocess.Popen(
            [sys.executable, "-m", "worker"], cwd=ROOT, env=environment(settings), stdout=log, stderr=log
        )
        try:
            yield Plant(server, server.client(server.admin_key))
        finally:
            worker.send_signal(signal.SIGTERM)
            worker.wait(timeout=60)
