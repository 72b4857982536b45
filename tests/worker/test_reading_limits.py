"""A file that costs too much to read ends by itself, at once, and says so; its processes go with it."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from service.db.jobs import request_cancel
from service.domain.lifecycle import JobState
from tests.formats.ifc_models import ModelWriter, Solid, bar
from tests.patience import soon
from tests.worker.test_running_jobs import is_alive, running_job_pid
from tests.worker.workbench import Workbench, a_slow_drawing, a_small_drawing, a_small_scan, children_of

pytestmark = pytest.mark.slow


def a_model(path: Path, *, walls: int) -> Path:
    """Write a storey of so many walls, each with an opening for the geometry kernel to cut."""
    writer = ModelWriter()
    solids = []
    for n in range(walls):
        x, y = 6.0 * (n % 40), 4.0 * (n // 40)
        hole = (bar(x + 1, y - 0.1, x + 2, y + 0.3), 0.0, 2.0)
        solids.append(Solid("IfcWall", bar(x, y, x + 5, y + 0.2), openings=[hole]))
    writer.storey("EG", 0.0, solids)
    return writer.write(path)


def too_costly(bench: Workbench, job_id: str, *, limit: str, file_name: str) -> dict[str, Any]:
    """Return the problem of a job that has to end as too costly at its first attempt."""
    job = bench.wait_final(job_id)
    assert (job.state, job.attempt) == (JobState.FAILED, 1), job.problem
    assert job.problem is not None
    assert (job.problem["slug"], job.problem.get("limit")) == ("reading-too-costly", limit), job.problem
    told = f"Reading {file_name} {'took' if limit == 'cpu' else 'held'} "
    assert job.problem["detail"].startswith(told), job.problem
    return job.problem


def kernel_of(job_pid: int) -> int:
    """Return the process that a job has started, once there is one."""
    return soon(lambda: children_of(job_pid), "the job started no process")[0]


def wait_gone(*pids: int) -> None:
    """Wait until the processes are gone."""
    soon(lambda: not any(is_alive(pid) for pid in pids), "a process outlives its end")


def test_a_drawing_over_its_cpu_ends_at_once(bench: Workbench, tmp_path: Path) -> None:
    with bench.worker(reading_cpu_s="0.3"):
        job_id = bench.add_drawing(a_slow_drawing(tmp_path / "plan.png", strokes=1500))
        problem = too_costly(bench, job_id, limit="cpu", file_name="plan.png")
        assert problem["cpu_used_s"] >= problem["cpu_limit_s"] == 0.3
        assert problem["pixels"] > 0
    with bench.worker():
        after = bench.add_drawing(a_small_drawing(tmp_path / "next.png"))
        assert bench.wait_final(after).state == JobState.SUCCEEDED


def test_what_the_file_promises_is_added_to_the_base(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench, path = sqlite_bench, tmp_path / "wide.png"
    Image.new("L", (12_000, 10_000), 255).save(path)
    with bench.worker(reading_cpu_s="0.1"):
        job = bench.wait_final(bench.add_drawing(path))
    assert job.problem is not None
    assert job.problem["slug"] == "no-walls-found"


def test_the_cpu_of_processes_that_a_job_starts_counts(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    with bench.worker(reading_cpu_s="0.4") as worker:
        job_id = bench.add_drawing(a_model(tmp_path / "house.ifc", walls=2000))
        job_pid = running_job_pid(worker)
        kernel = kernel_of(job_pid)
        too_costly(bench, job_id, limit="cpu", file_name="house.ifc")
        wait_gone(job_pid, kernel)


def test_a_cancelled_job_takes_what_it_started_with_it(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    with bench.worker() as worker:
        job_id = bench.add_drawing(a_model(tmp_path / "house.ifc", walls=2000))
        job_pid = running_job_pid(worker)
        kernel = kernel_of(job_pid)
        os.kill(kernel, signal.SIGSTOP)
        with bench.kernel.db.writing("cancel-job") as session:
            request_cancel(session, job_id, now=bench.kernel.now())
        assert bench.wait_final(job_id).state == JobState.CANCELLED
        wait_gone(job_pid, kernel)


def test_a_killed_job_takes_what_it_started_with_it(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    with bench.worker() as worker:
        bench.add_drawing(a_model(tmp_path / "house.ifc", walls=2000))
        job_pid = running_job_pid(worker)
        kernel = kernel_of(job_pid)
        os.kill(kernel, signal.SIGSTOP)
        os.kill(job_pid, signal.SIGKILL)
        wait_gone(job_pid, kernel)


@pytest.mark.parametrize("fault", [signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS])
def test_a_fault_of_the_reader_is_the_files_and_is_not_tried_again(
    sqlite_bench: Workbench, tmp_path: Path, fault: signal.Signals
) -> None:
    bench = sqlite_bench
    with bench.worker() as worker:
        job_id = bench.add_drawing(a_slow_drawing(tmp_path / "plan.png"))
        job_pid = running_job_pid(worker)
        bench.wait(job_id, lambda job: job.stage is not None)
        os.kill(job_pid, fault)
        job = bench.wait_final(job_id)
    assert (job.state, job.attempt) == (JobState.FAILED, 1)
    assert job.problem is not None
    assert (job.problem["slug"], job.problem["signal"]) == ("reader-crashed", fault.name)
    assert "plan.png" in job.problem["detail"]


def test_a_scan_within_its_limits_is_read(sqlite_bench: Workbench, tmp_path: Path) -> None:
    with sqlite_bench.worker():
        job = sqlite_bench.wait_final(sqlite_bench.add_scan(a_small_scan(tmp_path / "scan.pcd")))
    assert job.state == JobState.SUCCEEDED
