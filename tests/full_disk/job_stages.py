"""The disk is full at every stage of every job: each says so, and each ends well when there is room.

Run by `test_full_disk.py` in a mount namespace of its own.
"""

from __future__ import annotations

import hashlib
import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from sqlalchemy import select

from service.db.jobs import retry
from service.db.models import Blob, Job
from service.domain.lifecycle import MOST_FULL_TRIES, JobState
from tests.full_disk.small_disk import (
    RESERVE_BYTES,
    SmallDisk,
    let_go,
    mounted,
    order_halt,
    wait_halted,
)
from tests.patience import PATIENCE_S, soon
from tests.worker.workbench import Workbench, a_small_drawing, a_small_scan, kill

RECORDS = {
    "read-drawing": "record-drawing-reading",
    "read-scan": "record-scan-reading",
    "place-scan": "record-placement",
    "build-revision": "record-revision",
    "rebuild-revision": "record-rebuild",
    "make-delta": "record-delta",
    "compare-revisions": "record-comparison",
}
"""Each kind of job to the transaction that records its result."""

EVERYWHERE = (
    "claim-job.before-commit",
    "claim-job.after-commit",
    "message-job.before-send",
    "message-started.before-send",
    "message-progress.before-send",
    "blob.before-fsync",
    "blob.before-rename",
    "blob.after-rename",
)
"""Where every job comes by: claimed, handed over, begun, at its first stage, and when it keeps its files."""

_STAGE = "message-progress.before-send"
_BEFORE_IT_BEGAN = ("claim-job.before-commit", "claim-job.after-commit")
ENDING = ("message-done.before-send", "message-ended.before-send")
_PROGRESSES = {"build-revision": 6, "read-drawing": 2, "read-scan": 3}
"""How many messages of progress each kind surely sends: one for each stage, more only where it takes long."""

STAGES = [
    *((kind, point, 1) for kind in RECORDS for point in EVERYWHERE),
    *(
        (kind, f"{record}.{when}", 1)
        for kind, record in RECORDS.items()
        for when in ("before-commit", "after-commit")
    ),
    *((kind, _STAGE, n) for kind, last in _PROGRESSES.items() for n in range(2, last + 1)),
    *((kind, point, 1) for kind in ("read-drawing", "build-revision") for point in ENDING),
]
"""Kind of job, the point at which the disk is filled, and at which coming by."""

SOME = [
    ("read-drawing", "claim-job.before-commit", 1),
    ("read-drawing", "message-job.before-send", 1),
    ("read-scan", "message-progress.before-send", 3),
    ("build-revision", "message-progress.before-send", 2),
    ("build-revision", "blob.before-rename", 1),
    ("build-revision", "record-revision.before-commit", 1),
    ("place-scan", "record-placement.before-commit", 1),
    ("make-delta", "message-progress.before-send", 1),
]


_TOO_MUCH_BYTES = 8 << 20
"""What no compression makes smaller, of a disk of 64 MiB."""

_ROOM_BYTES = 3 << 20


class Story:
    """An installation on the small disk, with a drawing, a scan and two revisions, and a worker."""

    def __init__(self, disk: SmallDisk, folder: Path) -> None:
        self.disk = disk
        self.given: set[str] = set()
        data_dir = disk.folder / "data"
        self.bench = Workbench(data_dir, f"sqlite:///{data_dir}/groundplan.sqlite3")
        self.bench.prepare()
        self.picture = a_small_drawing(folder / "plan.png")
        self.cloud = a_small_scan(folder / "scan.pcd")
        self.worker = self.bench.start_worker(
            crash_at="@crash-at",
            lease_s="2",
            beat_s="0.05",
            reserve_bytes=str(RESERVE_BYTES),
            room_wait_s="0.2",
        )

    def prepare(self) -> None:
        """Let the worker make what the jobs need."""
        self.drawing = self.done(self.bench.add_drawing(self.picture))
        self.done(self.bench.add_revision(self.drawing, voxel_size_m=0.2))
        self.done(self.bench.add_revision(self.drawing, voxel_size_m=0.3))
        self.scan = self.done(self.bench.add_scan(self.cloud))

    def done(self, job_id: str) -> str:
        """Return the job, which has succeeded."""
        job = self.bench.wait_final(job_id)
        assert job.state == JobState.SUCCEEDED, job.problem
        return job_id

    def add(self, kind: str, salt: str) -> str:
        """Return a new job of a kind."""
        made: dict[str, Callable[[], str]] = {
            "read-drawing": lambda: self.bench.add_drawing(self.picture),
            "read-scan": lambda: self.bench.add_scan(self.cloud),
            "place-scan": lambda: self.bench.add_placement(self.scan, revision_n=1),
            "build-revision": lambda: self.bench.add_revision(self.drawing, voxel_size_m=0.2),
            "rebuild-revision": lambda: self.bench.add_rebuild(1),
            "make-delta": lambda: self._add_delta(self.cloud.read_bytes(), salt.encode()),
            "compare-revisions": lambda: self.bench.add_comparison(1, self._compared),
        }
        return made[kind]()

    def halt_delta(self, old: bytes, new: bytes) -> tuple[str, psutil.Process]:
        """Return the job of a delta between two files, and the process that is about to claim it."""
        order_halt(self.bench.data_dir, "claim-job.before-commit")
        self.given |= {hashlib.sha256(content).hexdigest() for content in (old, new)}
        job_id = self.bench.add_delta(old=old, new=new)
        return job_id, self._wait_halted(job_id)

    def _add_delta(self, old: bytes, more: bytes) -> str:
        self.given |= {hashlib.sha256(content).hexdigest() for content in (old, old + more)}
        return self.bench.add_delta(old=old, new=old + more)

    def _new_revision(self) -> int:
        self.done(self.bench.add_revision(self.drawing, voxel_size_m=0.3))
        with self.bench.kernel.db.reading() as session:
            return len(session.scalars(select(Job.id).where(Job.kind == "build-revision")).all())

    def halt(self, kind: str, point: str, nth: int) -> tuple[str, psutil.Process]:
        """Return a new job and the process that has come to the point for it."""
        if kind == "compare-revisions":
            self._compared = self._new_revision()
        order_halt(self.bench.data_dir, point)
        job_id = self.add(kind, f"{point} {nth}")
        for _ in range(nth - 1):
            process = self._wait_halted(job_id)
            order_halt(self.bench.data_dir, point)
            let_go(process)
        return job_id, self._wait_halted(job_id)

    def _wait_halted(self, job_id: str) -> psutil.Process:
        def is_over() -> bool:
            is_final = JobState(self.bench.job(job_id).state).is_final
            is_gone = is_final and not list((self.bench.data_dir / "jobs").iterdir())
            return is_gone and (self.bench.data_dir / "crash-at").exists()

        return wait_halted(self.worker.pid, self.bench.data_dir, is_over=is_over)


@pytest.fixture(scope="module")
def story(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Story]:
    """Give the installation."""
    folder = tmp_path_factory.mktemp("full")
    with mounted(folder / "disk") as disk:
        made = Story(disk, folder)
        try:
            made.prepare()
            yield made
        finally:
            disk.make_room()
            for process in [*psutil.Process(made.worker.pid).children(recursive=True)]:
                process.kill()
            kill(made.worker)
            made.bench.close()


def _cases() -> list[object]:
    stages = STAGES if os.environ.get("GROUNDPLAN_TEST_STAGES") == "all" else SOME
    return [pytest.param(*stage, id=f"{stage[0]}-{stage[1]}-{stage[2]}") for stage in stages]


@pytest.mark.parametrize(("kind", "point", "nth"), _cases())
def test_a_job_says_that_the_disk_is_full_and_ends_well(
    story: Story, kind: str, point: str, nth: int
) -> None:
    job_id, halted = story.halt(kind, point, nth)
    story.disk.fill()
    assert story.disk.free_bytes == 0
    let_go(halted)

    def is_clear() -> bool:
        job = story.bench.job(job_id)
        waits = job.state == JobState.QUEUED and (job.problem or {}).get("slug") == "storage-full"
        return waits or job.state == JobState.SUCCEEDED

    soon(is_clear, lambda: f"{kind} at {point}: {story.bench.job(job_id).state}")
    seen = story.bench.job(job_id)
    story.disk.make_room()
    job = story.bench.wait_final(job_id, patience_s=PATIENCE_S)
    print(f"{kind:18} {point:38} {nth} {seen.state:9} -> {job.state} at try {job.attempt}")  # noqa: T201
    assert (job.state, job.problem, job.attempt) == (JobState.SUCCEEDED, None, 1)
    filled = seen.state == JobState.QUEUED and point not in _BEFORE_IT_BEGAN
    assert job.full_tries == (1 if filled else 0), "tries are told apart by whether they began with room"
    assert story.worker.poll() is None, "no worker ends for want of room"
    assert_nothing_is_left(story.bench, given=story.given)


def test_a_job_that_does_not_fit_comes_to_an_end(story: Story) -> None:
    """There is room above the reserve, and never enough for what it writes."""
    content = random.Random(7).randbytes(_TOO_MUCH_BYTES)
    job_id, halted = story.halt_delta(content[:1000], content)
    story.disk.fill(leave_bytes=RESERVE_BYTES + _ROOM_BYTES)
    free_bytes = story.disk.free_bytes
    let_go(halted)
    job = story.bench.wait_final(job_id, patience_s=PATIENCE_S)
    assert (job.state, job.attempt, job.full_tries) == (JobState.FAILED, 1, MOST_FULL_TRIES)
    assert job.problem is not None
    told = {name: job.problem[name] for name in ("slug", "tries", "reserve_bytes")}
    assert told == {"slug": "storage-full", "tries": MOST_FULL_TRIES, "reserve_bytes": RESERVE_BYTES}
    assert RESERVE_BYTES <= job.problem["free_bytes"] <= free_bytes
    assert str(job.problem["free_bytes"]) in job.problem["detail"]
    print(f"make-delta that does not fit: {job.state} after {job.full_tries}: {job.problem['detail']}")  # noqa: T201
    story.done(story.add("read-scan", ""))
    story.disk.make_room()
    with story.bench.kernel.db.writing("retry-job") as session:
        retry(session, job_id, now=story.bench.kernel.now())
    story.done(job_id)
    assert story.bench.job(job_id).full_tries == 0
    assert_nothing_is_left(story.bench, given=story.given)


def assert_nothing_is_left(bench: Workbench, *, given: set[str]) -> None:
    """Assert that every file is a blob with a row, or `given` by the test, and every row has its blob."""
    with bench.kernel.db.reading() as session:
        rows = set(session.scalars(select(Blob.sha256)))
    assert {path.name for path in (bench.data_dir / "blobs").glob("??/*")} - given == rows - given
    soon(lambda: not list((bench.data_dir / "jobs").iterdir()), "the job's folder stays")
    assert list((bench.data_dir / "blobs" / ".tmp").iterdir()) == []
