"""kill -9 at every crash point of the worker, its warm child and its jobs: one result each, nothing stuck."""

from __future__ import annotations

import hashlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from sqlalchemy import func, select

from service.crash_points import CRASH_POINTS, MESSAGES
from service.db.comparisons import Comparison
from service.db.deltas import Delta
from service.db.models import Artifact, Blob, Drawing, Job, Placement, Revision, Scan
from service.domain.lifecycle import JobState
from tests.patience import PATIENCE_S
from tests.worker.workbench import Workbench, a_slow_drawing, a_small_drawing, a_small_scan, children_of, kill

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

PARENTS = {
    f"{name}.{when}-commit"
    for name in ("claim-job", "beat-job", "end-job", "redeliver-jobs")
    for when in ("before", "after")
} | {"message-job.before-send", "message-job.after-send"}
RECORDS = {
    f"record-{what}.{when}-commit"
    for what in ("drawing-reading", "scan-reading", "placement", "revision", "delta", "comparison", "rebuild")
    for when in ("before", "after")
}
BLOBS = {"blob.before-fsync", "blob.before-rename", "blob.after-rename"}
TOLD = {f"message-{kind}.{when}-send" for kind in MESSAGES for when in ("before", "after")}
POINTS = sorted(PARENTS | RECORDS | BLOBS | TOLD)
ONLY_DELIVERED = {"redeliver-jobs.before-commit", "redeliver-jobs.after-commit"}


@dataclass
class Outcome:
    """Hold what came of one crash."""

    point: str
    died: str
    state: str
    attempts: int
    seconds: float

    def __str__(self) -> str:
        """Return a line of the table."""
        return f"{self.point:42} {self.died:12} {self.state:10} {self.attempts:8} {self.seconds:8.1f}"


class Story:
    """Hold what the jobs of a crash need: a drawing that was read, a revision, a scan."""

    def __init__(self, bench: Workbench, folder: Path) -> None:
        self.bench = bench
        self.picture = a_small_drawing(folder / "plan.png")
        self.slow = a_slow_drawing(folder / "slow.png")
        self.text = folder / "letter.png"
        self.text.write_text("This is no picture.", encoding="ascii")
        self.cloud = a_small_scan(folder / "scan.pcd")
        self.settings = {"crash_at": "@crash-at", "lease_s": "2", "beat_s": "0.05"}
        self.worker = bench.start_worker(**self.settings)
        self.drawing = self.done(bench.add_drawing(self.picture))
        self.revision = self.done(bench.add_revision(self.drawing, voxel_size_m=0.2))
        self.scan = self.done(bench.add_scan(self.cloud))

    def done(self, job_id: str) -> str:
        """Return the job, which has succeeded."""
        assert self.bench.wait_final(job_id).state == JobState.SUCCEEDED
        return job_id

    def number(self, job_id: str) -> int:
        """Return the number of the revision that a job built."""
        with self.bench.kernel.db.reading() as session:
            return session.scalars(select(Revision.n).where(Revision.job_id == job_id)).one()

    def job_for(self, point: str) -> str:
        """Return a new job that passes the point."""
        makers: dict[str, Callable[[], str]] = {
            "record-scan-reading": lambda: self.bench.add_scan(self.cloud),
            "record-placement": lambda: self.bench.add_placement(self.scan, revision_n=1),
            "record-revision": lambda: self.bench.add_revision(self.drawing, voxel_size_m=0.2),
            "record-delta": lambda: self.bench.add_delta(
                old=self.cloud.read_bytes(), new=self.cloud.read_bytes() + point.encode()
            ),
            "record-comparison": lambda: self.bench.add_comparison(
                1, self.number(self.done(self.bench.add_revision(self.drawing, voxel_size_m=0.3)))
            ),
            "record-rebuild": lambda: self.bench.add_rebuild(1),
            "beat-job": lambda: self.bench.add_drawing(self.slow),
            "end-job": lambda: self.bench.add_drawing(self.text),
            "message-failed": lambda: self.bench.add_drawing(self.text),
        }
        default = (
            makers["record-revision"] if point in BLOBS else lambda: self.bench.add_drawing(self.picture)
        )
        return makers.get(point.partition(".")[0], default)()

    def crash(self, point: str) -> Outcome:
        """Let a process die at the point, start the worker anew if it was that, and see it through."""
        begun = time.monotonic()
        self.bench.order_crash(point)
        if point.startswith("message-ready"):
            kill_all(children_of(self.worker.pid))
        job_id = self.job_for(point)
        died = "child or job"
        while not (self.bench.has_crashed and JobState(self.bench.job(job_id).state).is_final):
            if self.worker.poll() is not None:
                died, self.worker = "worker", self.bench.start_worker(**self.settings)
            assert time.monotonic() - begun < PATIENCE_S, (
                point,
                self.bench.job(job_id).state,
                self.bench.log()[-3000:],
            )
            time.sleep(0.05)
        if point in PARENTS and died != "worker":
            self.worker.wait(PATIENCE_S)
            died, self.worker = "worker", self.bench.start_worker(**self.settings)
        job = self.bench.job(job_id)
        return Outcome(point, died, job.state, job.attempt, time.monotonic() - begun)


def kill_all(pids: list[int]) -> None:
    for pid in pids:
        os.kill(pid, signal.SIGKILL)


def assert_whole(bench: Workbench) -> None:
    """Assert that every job has ended, each result is there once, and each blob of a row is whole."""
    with bench.kernel.db.reading() as session:
        assert not session.scalars(select(Job).where(Job.state.in_(["queued", "running"]))).all()
        succeeded = {j.id: j for j in session.scalars(select(Job).where(Job.state == "succeeded"))}
        for revision in session.scalars(select(Revision)):
            assert revision.status == ("ready" if revision.job_id in succeeded else "failed")
            paths = session.scalars(select(Artifact.path).where(Artifact.revision_id == revision.id)).all()
            assert ("package.tar" in paths) == (revision.status == "ready")
        for table, result in (
            (Drawing, Drawing.reading),
            (Scan, Scan.reading),
            (Placement, Placement.verdict),
            (Delta, Delta.sha256),
            (Comparison, Comparison.picture_sha256),
        ):
            for job_id, value in session.execute(select(table.job_id, result)):
                assert (value is not None) == (job_id in succeeded)
        for blob in session.scalars(select(Blob)):
            data = bench.kernel.blobs.path(blob.sha256).read_bytes()
            assert hashlib.sha256(data).hexdigest() == blob.sha256
        ready = session.scalar(select(func.count()).where(Revision.status == "ready"))
        built = sum(j.kind == "build-revision" for j in succeeded.values())
        assert ready == built


def test_the_points_tried_here_and_at_the_service_are_all_that_there_are() -> None:
    assert set(POINTS) <= CRASH_POINTS


SAMPLE = [
    "claim-job.after-commit",
    "end-job.before-commit",
    "message-done.before-send",
    "message-started.after-send",
    "record-comparison.before-commit",
    "record-delta.before-commit",
    "record-placement.before-commit",
    "record-rebuild.before-commit",
    "record-revision.after-commit",
    "record-revision.before-commit",
]


@pytest.mark.parametrize(
    "points", [pytest.param(SAMPLE, id="some"), pytest.param(POINTS, id="all", marks=pytest.mark.crash)]
)
def test_a_kill_at_each_point_leaves_one_result_and_nothing_stuck(
    bench: Workbench, tmp_path: Path, points: list[str]
) -> None:
    story = Story(bench, tmp_path)
    points = [p for p in points if not (bench.kernel.db.is_sqlite and p in ONLY_DELIVERED)]
    outcomes = []
    try:
        for point in points:
            outcomes.append(story.crash(point))
            print(outcomes[-1])  # noqa: T201 - the table of points and outcomes
    finally:
        kill(story.worker)
    for outcome in outcomes:
        refused = outcome.point.startswith(("end-job", "message-failed"))
        assert outcome.state == ("failed" if refused else "succeeded"), outcome
        assert (outcome.died == "worker") == (outcome.point in PARENTS), outcome
        kills = 2 if outcome.point.startswith("message-ready") else 1  # the warm child before it, too
        assert outcome.attempts <= kills + 1, outcome
    assert_whole(bench)
