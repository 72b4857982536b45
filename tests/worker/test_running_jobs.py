"""Real worker processes: limits, cancel, deaths, release, sharing, and sleep past a lease."""

from __future__ import annotations

import os
import signal
import time
from collections import Counter
from pathlib import Path

import pytest
from PIL import Image
from sqlalchemy import select

from service.db.jobs import request_cancel
from service.db.models import Artifact, Drawing, Job, Revision
from service.domain.lifecycle import JobState
from tests.forked import Forked
from tests.patience import soon
from tests.worker.workbench import (
    Workbench,
    a_slow_drawing,
    a_small_drawing,
    a_small_scan,
    children_of,
    kill,
)

pytestmark = pytest.mark.slow


def running_job_pid(worker: Forked) -> int:
    """Return the process that does the worker's job, once there is one."""
    return soon(
        lambda: [job for warm in children_of(worker.pid) for job in children_of(warm)],
        "no job process appeared",
    )[0]


def wait_idle(worker: Forked) -> None:
    """Wait until the process of the worker's last job is gone."""
    soon(
        lambda: not any(children_of(warm) for warm in children_of(worker.pid)), "the last job's process stays"
    )


def test_a_drawing_becomes_a_revision_and_a_scan_is_placed_on_it(bench: Workbench, tmp_path: Path) -> None:
    with bench.worker() as worker:
        drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        assert bench.wait_final(drawing).state == JobState.SUCCEEDED
        builds = [bench.add_revision(drawing, voxel_size_m=0.1) for _ in range(2)]
        for build in builds:
            assert bench.wait_final(build).state == JobState.SUCCEEDED
        scan = bench.add_scan(a_small_scan(tmp_path / "scan.pcd"))
        assert bench.wait_final(scan).state == JobState.SUCCEEDED
        placement = bench.wait_final(bench.add_placement(scan, revision_n=2))
        assert placement.state == JobState.SUCCEEDED, placement.problem
        worker.send_signal(signal.SIGTERM)
        assert worker.wait(20) == 0
    with bench.kernel.db.reading() as session:
        read = session.scalars(select(Drawing)).one()
        assert read.reading is not None
        assert read.reading["counts"]["walls"] >= 4
        revisions = session.scalars(select(Revision).order_by(Revision.n)).all()
        made = [
            dict(
                session.execute(
                    select(Artifact.path, Artifact.sha256).where(Artifact.revision_id == r.id)
                ).all()
            )  # type: ignore[arg-type]
            for r in revisions
        ]
    assert made[0] == made[1]
    assert {path for path in made[0] if not path.startswith("tiles/")} == {
        "point-cloud.pcd",
        "point-cloud.pcd.zst",
        "pointcloud_map_metadata.yaml",
        "map_projector_info.yaml",
        "occupancy-grid.pgm",
        "occupancy-grid.pgm.zst",
        "occupancy-grid.yaml",
        "octree.bin",
        "octree.json",
        "walls.geojson",
        "walls.geojson.zst",
        "manifest.json",
        "package.tar",
        "preview.png",
        "report.json",
    }
    assert {path for path, sha in made[0].items() if path == f"tiles/{sha}.pcd"} == {
        path for path in made[0] if path.startswith("tiles/")
    }
    assert not list((bench.data_dir / "jobs").iterdir())


def test_a_refused_input_fails_at_once_and_says_why(bench: Workbench, tmp_path: Path) -> None:
    letter = tmp_path / "letter.png"
    letter.write_text("This is no picture.", encoding="ascii")
    with bench.worker():
        job = bench.wait_final(bench.add_drawing(letter))
    assert (job.state, job.attempt) == (JobState.FAILED, 1)
    assert job.problem is not None
    assert job.problem["slug"] == "unsupported-media"


def test_a_defect_fails_after_one_attempt_and_keeps_its_trace_to_the_log(
    sqlite_bench: Workbench, tmp_path: Path
) -> None:
    bench = sqlite_bench
    drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
    with bench.kernel.db.writing("receive-drawing") as session:
        row = session.scalars(select(Drawing).where(Drawing.job_id == drawing)).one()
        row.options = {"page": 1, "scale": {"metres_per_unit": "no number"}}
    with bench.worker():
        job = bench.wait_final(drawing)
    assert (job.state, job.attempt) == (JobState.FAILED, 1)
    assert job.problem is not None
    assert "Traceback" not in str(job.problem)


def test_a_running_job_is_cancelled_within_a_beat(bench: Workbench, tmp_path: Path) -> None:
    with bench.worker(beat_s="0.5") as worker:
        job_id = bench.add_drawing(a_slow_drawing(tmp_path / "plan.png"))
        os.kill(running_job_pid(worker), signal.SIGSTOP)
        with bench.kernel.db.writing("cancel-job") as session:
            request_cancel(session, job_id, now=bench.kernel.now())
        job = bench.wait_final(job_id)
        assert (job.state, job.problem) == (JobState.CANCELLED, None)
        after = bench.add_drawing(a_small_drawing(tmp_path / "next.png"))
        assert bench.wait_final(after).state == JobState.SUCCEEDED


def test_a_job_over_its_memory_is_stopped_and_says_so(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    path = tmp_path / "large.png"
    Image.new("L", (14000, 14000), 255).save(path)
    with bench.worker(job_memory_bytes=str(700 * 1024 * 1024)):
        job = bench.wait_final(bench.add_drawing(path))
        assert (job.state, job.attempt) == (JobState.FAILED, 1)
        assert job.problem is not None
        assert (job.problem["slug"], job.problem["limit"]) == ("reading-too-costly", "memory")
        after = bench.add_drawing(a_small_drawing(tmp_path / "next.png"))
        assert bench.wait_final(after).state == JobState.SUCCEEDED


def test_a_job_over_its_time_is_stopped_and_says_so(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    with bench.worker(job_wall_s="1.5") as worker:
        job_id = bench.add_drawing(a_slow_drawing(tmp_path / "plan.png"))
        bench.wait(job_id, lambda job: job.stage is not None)
        os.kill(running_job_pid(worker), signal.SIGSTOP)
        job = bench.wait_final(job_id)
    assert (job.state, job.attempt) == (JobState.FAILED, 1)
    assert job.problem is not None
    assert (job.problem["slug"], job.problem["limit"]) == ("reading-too-costly", "wall")
    assert job.problem["wall_used_s"] >= job.problem["wall_limit_s"] == 1.5


@pytest.mark.parametrize(
    ("settings", "slug", "limit", "used"),
    [
        ({"job_cpu_s": "0.05"}, "job-timed-out", "cpu", "cpu_used_s"),
        ({"job_memory_bytes": str(1 << 20)}, "job-out-of-memory", "memory", "memory_used_bytes"),
        ({"job_wall_s": "0.05"}, "job-timed-out", "wall", "wall_used_s"),
    ],
)
def test_a_build_over_a_limit_is_stopped_and_says_so(
    sqlite_bench: Workbench, tmp_path: Path, settings: dict[str, str], slug: str, limit: str, used: str
) -> None:
    bench = sqlite_bench
    with bench.worker():
        drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        assert bench.wait_final(drawing).state == JobState.SUCCEEDED
    build = bench.add_revision(drawing, voxel_size_m=0.02)
    with bench.worker(**settings):
        job = bench.wait_final(build)
    assert (job.state, job.attempt) == (JobState.FAILED, 1)
    assert job.problem is not None
    assert (job.problem["slug"], job.problem["limit"]) == (slug, limit), job.problem
    assert job.problem[used] > 0
    assert f"GROUNDPLAN_JOB_{limit.upper()}" in job.problem["detail"]


def test_a_job_whose_process_dies_three_times_fails_as_crashed(
    sqlite_bench: Workbench, tmp_path: Path
) -> None:
    bench = sqlite_bench
    drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
    with bench.worker(crash_at="record-drawing-reading.before-commit"):
        job = bench.wait_final(drawing)
    assert (job.state, job.attempt) == (JobState.FAILED, 3)
    assert job.problem is not None
    assert (job.problem["slug"], job.problem["attempts"]) == ("job-crashed", 3)
    assert job.problem["last"] == "killed by signal 9 (SIGKILL)"
    assert "Retry it once; if it ends so again, the worker's log tells the cause" in job.problem["detail"]


def test_a_worker_that_is_told_to_stop_gives_its_job_back(bench: Workbench, tmp_path: Path) -> None:
    with bench.worker() as first:
        job_id = bench.add_drawing(a_slow_drawing(tmp_path / "plan.png"))
        os.kill(running_job_pid(first), signal.SIGSTOP)
        first.send_signal(signal.SIGTERM)
        assert first.wait(20) == 0
    job = bench.job(job_id)
    assert (job.state, job.attempt) == (JobState.QUEUED, 0)
    with bench.worker():
        assert bench.wait_final(job_id).attempt == 1


def test_no_process_outlives_a_killed_worker(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    with bench.worker() as worker:
        bench.add_drawing(a_slow_drawing(tmp_path / "plan.png"))
        pids = [running_job_pid(worker), *children_of(worker.pid)]
        kill(worker)
        soon(lambda: not any(is_alive(pid) for pid in pids), "a process outlives the worker")


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.parametrize("sleeper", ["worker", "worker and job"])
def test_a_worker_that_sleeps_past_its_lease_changes_nothing_when_it_wakes(
    bench: Workbench, tmp_path: Path, sleeper: str
) -> None:
    drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
    settings = {"lease_s": "2", "beat_s": "0.3"}
    with bench.worker(**settings) as first:
        assert bench.wait_final(drawing).state == JobState.SUCCEEDED
        wait_idle(first)
        slow = bench.add_drawing(a_slow_drawing(tmp_path / "slow.png"))
        job_pid = running_job_pid(first)
        stopped = [first.pid, job_pid] if sleeper == "worker and job" else [first.pid]
        os.kill(job_pid, signal.SIGSTOP)
        for pid in stopped:
            os.kill(pid, signal.SIGSTOP)
        build = bench.add_revision(drawing)
        with bench.worker(**settings):
            heir = bench.wait(slow, lambda j: j.attempt == 2)
            assert bench.wait_final(build).state == JobState.SUCCEEDED
            ended = bench.wait_final(slow)
            assert ended.attempt_token == heir.attempt_token
            for pid in stopped:
                os.kill(pid, signal.SIGCONT)
            later = bench.add_revision(drawing)
            assert bench.wait_final(later).state == JobState.SUCCEEDED
            time.sleep(1.0)
            woken = bench.job(slow)
            assert (woken.state, woken.attempt, woken.attempt_token, woken.changed) == (
                ended.state,
                2,
                heir.attempt_token,
                ended.changed,
            )
    with bench.kernel.db.reading() as session:
        assert [r.status for r in session.scalars(select(Revision))] == ["ready", "ready"]


@pytest.mark.postgres
def test_two_workers_share_fifty_jobs(postgres_url: str, tmp_path: Path) -> None:
    bench = Workbench(tmp_path / "data", postgres_url)
    bench.prepare()
    picture = a_small_drawing(tmp_path / "plan.png")
    with bench.worker() as first, bench.worker() as second:
        for _ in range(2):
            bench.wait_final(bench.add_drawing(picture))
        time.sleep(6.0)  # both have their warm child by now
        job_ids = [bench.add_drawing(picture) for _ in range(50)]
        done = [bench.wait_final(job_id, patience_s=120.0) for job_id in job_ids]
    names = {first.pid: 0, second.pid: 0}
    shares = Counter(int((job.worker or ":0").rpartition(":")[2]) for job in done)
    assert {job.state for job in done} == {JobState.SUCCEEDED}
    assert {job.attempt for job in done} == {1}
    assert set(shares) == set(names)
    assert min(shares.values()) >= 10, shares
    with bench.kernel.db.reading() as session:
        read = session.scalars(select(Drawing).where(Drawing.job_id.in_(job_ids))).all()
        assert len(read) == 50
        assert all(drawing.reading is not None for drawing in read)
        assert not session.scalars(select(Job).where(Job.state != "succeeded")).all()
    print(f"50 jobs: {dict(shares)}")  # noqa: T201 - the share of each worker
    bench.close()
