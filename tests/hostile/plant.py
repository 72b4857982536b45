"""A real service with a real worker that files are pushed through, and all that it answers afterwards."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from service.settings import Settings
from tests.forked import forked
from tests.hostile.known import READING
from tests.patience import PATIENCE_S, soon
from tests.server import Server, environment, running

MOST_CPU_S, MOST_MIB = 10.0, 1024
"""What reading a file may take at most."""

_FINAL = {"succeeded", "failed", "cancelled"}
_NO_PROBLEMS = {"job-crashed", "about:blank", "job-timed-out", "job-out-of-memory"}
_PARAMETER = re.compile(r"\{(\w+)\}")
_PATIENCE_S = 600.0
_FILES = {
    "drawings": ("preview.png", "walls.geojson", "removed.geojson"),
    "scans": ("preview.png", "points"),
}


@dataclass(frozen=True)
class Upload:
    """Hold an upload: what was answered, and the ids of all that it made."""

    collection: str
    answer: httpx.Response
    ids: dict[str, str]


@dataclass(frozen=True)
class Ending:
    """Hold how an upload ended: as a reading or as a problem, what it took, and what is wrong with that."""

    end: str
    detail: str = ""
    findings: tuple[str, ...] = ()
    cpu_s: float = 0.0
    peak_mib: int = 0
    faults: list[str] = field(default_factory=list)


class Plant:
    """Push files through an upload and a job, and ask for every list and each thing.

    Parameters
    ----------
    server : Server
        A running service; its worker runs beside it.
    log : Path
        Where the worker writes.
    """

    def __init__(self, server: Server, log: Path) -> None:
        self.server = server
        self.client = server.client(server.admin_key)
        made = self.client.post("/v1/maps", json={"site": "plant", "name": "hostile"})
        self.map_id: str = made.json()["id"]
        self._log, self._read, self._took = log, 0, dict[str, tuple[float, int]]()
        told = self.client.get("/openapi.json").json()["paths"]
        self._gets = [
            path for path, verbs in told.items() if "get" in verbs and _is_asked(path, verbs["get"])
        ]

    def send(self, collection: str, content: bytes, *, name: str = "plan.dat") -> Upload:
        """Return an upload whose job may still run."""
        answer = self.client.post(f"/v1/maps/{self.map_id}/{collection}", files={"file": (name, content)})
        ids = {"map_id": self.map_id}
        if answer.status_code == 202:
            thing = collection.removesuffix("s")
            ids |= {"job_id": answer.json()["job"]["id"], f"{thing}_id": answer.json()[thing]["id"]}
        return Upload(collection, answer, ids)

    def ending(self, upload: Upload) -> Ending:
        """Return how an upload ended, once it has, and whether all lists and its things answer."""
        if "job_id" not in upload.ids:
            ending = self._refused(upload.answer)
        else:
            ending = self._of_job(upload, self._ended(upload.ids["job_id"]))
        if ending.end in _NO_PROBLEMS:
            ending.faults.append(f"ended as {ending.end}")
        if ending.cpu_s > MOST_CPU_S:
            ending.faults.append(f"took {ending.cpu_s} s of CPU")
        if ending.peak_mib > MOST_MIB:
            ending.faults.append(f"took {ending.peak_mib} MiB")
        ending.faults.extend(self._unwell(upload.ids))
        return ending

    def _refused(self, answer: httpx.Response) -> Ending:
        if not 400 <= answer.status_code < 500:
            return Ending("none", faults=[f"the upload answers {answer.status_code} {answer.text[:200]}"])
        problem = answer.json()
        return Ending(_slug(problem), problem["detail"])

    def _of_job(self, upload: Upload, job: dict[str, Any]) -> Ending:
        cpu_s, peak_mib = self._cost(upload.ids["job_id"])
        if job["state"] != "succeeded":
            problem = job["problem"]
            return Ending(_slug(problem), problem["detail"], cpu_s=cpu_s, peak_mib=peak_mib)
        thing = f"/v1/{upload.collection}/{upload.ids[upload.collection.removesuffix('s') + '_id']}"
        reading = self.client.get(thing).json()["reading"]
        codes = tuple(finding["code"] for finding in reading["findings"])
        ending = Ending(READING, findings=codes, cpu_s=cpu_s, peak_mib=peak_mib)
        for name in _FILES[upload.collection]:
            answer = self.client.get(f"{thing}/{name}")
            if answer.status_code != 200:
                ending.faults.append(f"GET {name} of the reading: {answer.status_code}")
        return ending

    def _ended(self, job_id: str) -> dict[str, Any]:
        def final() -> dict[str, Any] | None:
            job: dict[str, Any] = self.client.get(f"/v1/jobs/{job_id}").json()
            return job if job["state"] in _FINAL else None

        return soon(final, f"{job_id} never ended", patience_s=_PATIENCE_S)

    def _cost(self, job_id: str) -> tuple[float, int]:
        """Return the CPU seconds and the MiB of a job, as its worker wrote them (rusage) at its end."""

        def told() -> tuple[float, int] | None:
            self._read_on()
            return self._took.get(job_id)

        return soon(told, f"{job_id} never ended in {self._log}", patience_s=_PATIENCE_S)

    def _read_on(self) -> None:
        """Take note of the jobs that the worker's log says to have ended since it was read last."""
        with self._log.open("rb") as log:
            log.seek(self._read)
            for line in log:
                if not line.endswith(b"\n"):
                    break
                self._read += len(line)
                if b'"job ended"' in line:
                    said = json.loads(line)
                    cpu_s, peak_mib = self._took.get(said["job"], (0.0, 0))
                    self._took[said["job"]] = (cpu_s + said["cpu_s"], max(peak_mib, said["peak_mib"]))

    def _unwell(self, ids: dict[str, str]) -> Iterator[str]:
        """Yield which lists, and which things of an upload by their ids, do not answer 200 with JSON."""
        for path in self._gets:
            if set(_PARAMETER.findall(path)) <= ids.keys():
                answer = self.client.get(path.format(**ids))
                if answer.status_code != 200:
                    yield f"GET {path}: {answer.status_code} {answer.text[:200]}"
                else:
                    answer.json()


def _is_asked(path: str, told: dict[str, Any]) -> bool:
    """Return whether a path is that of a list, or of one thing by its id."""
    schema = told["responses"]["200"].get("content", {}).get("application/json", {}).get("schema", {})
    return "/Page_" in schema.get("$ref", "") or path.endswith("_id}")


def _slug(problem: dict[str, Any]) -> str:
    assert problem["title"], problem
    assert problem["detail"], problem
    slug: str = problem["type"].rpartition("/")[2]
    return slug


@contextmanager
def working(settings: Settings) -> Iterator[Plant]:
    """Run a service and a worker until the block ends."""
    with running(settings) as server:
        path = settings.data_dir / "worker.log"
        with path.open("ab") as log:
            worker = forked("worker", env=environment(settings), stdout=log, stderr=log)
        try:
            yield Plant(server, path)
        finally:
            worker.send_signal(signal.SIGTERM)
            worker.wait(timeout=PATIENCE_S)
