"""How soon a small job starts and ends with a warm child, beside a child that is started for it."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

from service.domain.lifecycle import JobState
from tests.worker.workbench import Workbench, a_small_drawing

pytestmark = pytest.mark.benchmark

ROUNDS = 10


def test_a_small_job_starts_in_a_warm_child(tmp_path: Path) -> None:
    bench = Workbench(tmp_path / "data", f"sqlite:///{tmp_path}/groundplan.sqlite3")
    bench.prepare()
    picture = a_small_drawing(tmp_path / "plan.png")
    starts, first_words, ends = [], [], []
    with bench.worker(beat_s="0.05"):
        assert bench.wait_final(bench.add_drawing(picture)).state == JobState.SUCCEEDED
        for _ in range(ROUNDS):
            begun = time.monotonic()
            job_id = bench.add_drawing(picture)
            queued = time.monotonic()
            bench.wait(job_id, lambda job: job.started_at is not None)
            starts.append(time.monotonic() - queued)
            bench.wait(job_id, lambda job: job.stage is not None or JobState(job.state).is_final)
            first_words.append(time.monotonic() - queued)
            assert bench.wait_final(job_id).state == JobState.SUCCEEDED
            ends.append(time.monotonic() - begun)
    bench.close()
    begun = time.monotonic()
    subprocess.run([sys.executable, "-c", "import worker.child"], check=True)
    cold = time.monotonic() - begun
    print(
        f"\nqueued -> claimed {statistics.median(starts):.3f} s,"
        f" -> its own first word {statistics.median(first_words):.3f} s,"
        f" -> done {statistics.median(ends):.3f} s (medians of {ROUNDS});"
        f" imports alone, which a cold child would do first: {cold:.2f} s"
    )
