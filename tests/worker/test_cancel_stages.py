"""A drawing's job is cancelled at whatever stage it stands, and the worker goes on to the next."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from sqlalchemy import select

from service.db.jobs import request_cancel
from service.db.models import Drawing
from service.domain.lifecycle import JobState
from tests.worker.workbench import Workbench, a_slow_drawing, a_small_drawing, children_of

pytestmark = pytest.mark.slow

STAGES = (0.0, 0.3, 0.6)


def test_a_drawing_is_cancelled_at_any_stage(sqlite_bench: Workbench, tmp_path: Path) -> None:
    bench = sqlite_bench
    path = a_slow_drawing(tmp_path / "plan.png", strokes=6000)
    stages = []
    with bench.worker(beat_s="0.2") as worker:
        for least in STAGES:
            job_id = bench.add_drawing(path, metres_per_px=0.02)
            running = bench.wait(job_id, lambda j, least=least: j.state != "queued" and j.fraction >= least)
            assert running.state == JobState.RUNNING
            for job in [pid for warm in children_of(worker.pid) for pid in children_of(warm)]:
                os.kill(job, signal.SIGSTOP)
            with bench.kernel.db.writing("cancel-job") as session:
                request_cancel(session, job_id, now=bench.kernel.now())
            ended = bench.wait_final(job_id)
            assert (ended.state, ended.problem) == (JobState.CANCELLED, None)
            stages.append(running.stage)
        after = bench.add_drawing(a_small_drawing(tmp_path / "next.png"))
        assert bench.wait_final(after).state == JobState.SUCCEEDED
        worker.send_signal(signal.SIGTERM)
        assert worker.wait(20) == 0
    assert len(set(stages)) == len(STAGES)
    with bench.kernel.db.reading() as session:
        readings = session.scalars(select(Drawing.reading).order_by(Drawing.id)).all()
    assert [reading is None for reading in readings] == [True, True, True, False]
    assert not list((bench.data_dir / "jobs").iterdir())
