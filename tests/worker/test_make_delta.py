"""A delta made by a real worker, on both databases: asked for once, made once, read by the zstd program."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from sqlalchemy import select

from service.db.deltas import Delta
from service.db.models import Job
from service.domain.access import Actor
from service.domain.errors import DeltaNotReady
from service.domain.lifecycle import JobState, Role
from service.usecases.deltas import ask_for_delta, delta_file, dictionary_form
from service.usecases.download import CLOUD_PATH, artifact_file
from tests.worker.workbench import Workbench, a_small_drawing

pytestmark = pytest.mark.slow


def test_a_worker_makes_the_delta_that_a_robot_asked_for(bench: Workbench, tmp_path: Path) -> None:
    admin = Actor(bench.key_id, Role.ADMIN)
    with bench.worker():
        drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        assert bench.wait_final(drawing).state == JobState.SUCCEEDED
        for build in [bench.add_revision(drawing, floor=floor) for floor in (False, True)]:
            assert bench.wait_final(build).state == JobState.SUCCEEDED
        with pytest.raises(DeltaNotReady) as told:
            delta_file(bench.kernel, admin, map_id=bench.map_id, n=2, from_n=1)
        assert told.value.members["retry_after_s"] == 1
        job = bench.wait_final(told.value.members["job_id"])
        assert job.state == JobState.SUCCEEDED, job.problem
    delta = delta_file(bench.kernel, admin, map_id=bench.map_id, n=2, from_n=1)
    with bench.kernel.db.reading() as session:
        old, new = (
            artifact_file(bench.kernel, session, admin, map_id=bench.map_id, n=n, path=CLOUD_PATH)
            for n in (1, 2)
        )
        assert len(session.scalars(select(Delta)).all()) == 1
        assert len(session.scalars(select(Job).where(Job.kind == "make-delta")).all()) == 1
    patch = ["zstd", "-dqc", "--long=31", f"--patch-from={old.path}", delta.path]
    assert subprocess.run(patch, capture_output=True, check=True).stdout == new.path.read_bytes()
    again = ask_for_delta(
        bench.kernel, admin, map_id=bench.map_id, from_sha256=old.sha256, to_sha256=new.sha256
    )
    assert again == job.id
    form = dictionary_form(
        bench.kernel, admin, map_id=bench.map_id, held_sha256=old.sha256, wanted_sha256=new.sha256
    )
    assert form is not None
    assert form.size_bytes == delta.size_bytes + 40
