"""Whose turn it is: no key's files, however many wait, hold what another key asks for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import select

from service.db import jobs
from service.db.jobs import Attempt
from service.db.models import Job
from service.domain.lifecycle import JobKind, JobState
from tests.worker.workbench import Workbench, a_slow_drawing, a_small_drawing

FILES = 50


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return a_small_drawing(tmp_path / "plan.png")


def claim(bench: Workbench) -> Attempt:
    with bench.kernel.db.writing("claim-job") as session:
        attempt = jobs.claim(
            session, worker="w", token=bench.kernel.new_id("att"), lease_s=600.0, now=bench.kernel.now()
        )
    assert attempt is not None
    return attempt


def end(bench: Workbench, attempt: Attempt) -> None:
    with bench.kernel.db.writing("end-job") as session:
        jobs.finish_succeeded(session, attempt, now=bench.kernel.now())


def served(bench: Workbench, count: int) -> list[str]:
    """Return the jobs that one worker does, one after the other."""
    done = []
    for _ in range(count):
        attempt = claim(bench)
        done.append(attempt.job_id)
        end(bench, attempt)
    return done


def many(add: Callable[[], str], count: int) -> list[str]:
    return [add() for _ in range(count)]


@pytest.mark.parametrize("is_busy", [False, True], ids=["no worker yet", "one file is being read"])
def test_another_keys_build_is_the_next_job(bench: Workbench, plan: Path, *, is_busy: bool) -> None:
    with bench.another():
        drawing = bench.add_drawing(plan)
        end(bench, claim(bench))
        key_id, map_id = bench.key_id, bench.map_id
    files = many(lambda: bench.add_drawing(plan), FILES)
    running = claim(bench) if is_busy else None
    bench_key, bench_map = bench.key_id, bench.map_id
    bench.key_id, bench.map_id = key_id, map_id
    build = bench.add_revision(drawing)
    bench.key_id, bench.map_id = bench_key, bench_map
    assert claim(bench).job_id == build
    assert claim(bench).job_id == (files[1] if running else files[0])


def test_another_keys_file_waits_for_one_file_at_most(bench: Workbench, plan: Path) -> None:
    files = many(lambda: bench.add_drawing(plan), FILES)
    running = claim(bench)
    with bench.another(a_map=False):
        other = bench.add_drawing(plan)
    assert (running.job_id, claim(bench).job_id) == (files[0], other)


def test_a_keys_builds_do_not_hold_another_keys_file(bench: Workbench, plan: Path) -> None:
    drawing = bench.add_drawing(plan)
    end(bench, claim(bench))
    builds = many(lambda: bench.add_revision(drawing), 10)
    with bench.another():
        file = bench.add_drawing(plan)
    assert served(bench, 3) == [builds[0], file, builds[1]]


def test_two_keys_take_turns_and_each_keeps_its_order(bench: Workbench, plan: Path) -> None:
    mine = many(lambda: bench.add_drawing(plan), 4)
    with bench.another(a_map=False):
        theirs = many(lambda: bench.add_drawing(plan), 4)
    in_turns = [job for pair in zip(mine, theirs, strict=True) for job in pair]
    assert served(bench, 8) == in_turns


def test_a_keys_maps_take_turns(bench: Workbench, plan: Path) -> None:
    first = many(lambda: bench.add_drawing(plan), 4)
    with bench.another(key=False):
        second = many(lambda: bench.add_drawing(plan), 2)
    assert served(bench, 5) == [first[0], second[0], first[1], second[1], first[2]]


def test_a_key_with_many_maps_has_one_turn(bench: Workbench, plan: Path) -> None:
    mine = [bench.add_drawing(plan)]
    for _ in range(3):
        with bench.another(key=False):
            mine.append(bench.add_drawing(plan))
    with bench.another():
        theirs = many(lambda: bench.add_drawing(plan), 2)
    assert served(bench, 4) == [mine[0], theirs[0], mine[1], theirs[1]]


def test_a_key_that_worked_alone_owes_nothing(bench: Workbench, plan: Path) -> None:
    for _ in range(5):
        bench.add_drawing(plan)
        end(bench, claim(bench))
    mine = many(lambda: bench.add_drawing(plan), 2)
    with bench.another():
        theirs = many(lambda: bench.add_drawing(plan), 2)
    assert served(bench, 4) == [mine[0], theirs[0], mine[1], theirs[1]]


def test_a_lost_job_whose_attempts_are_used_up_does_not_stop_the_claim(bench: Workbench, plan: Path) -> None:
    lost = bench.add_drawing(plan)
    claim(bench)
    with bench.kernel.db.writing("claim-job") as session:
        job = session.get_one(Job, lost)
        job.attempt, job.lease_until = 3, bench.kernel.now().replace(year=2020)
    after = bench.add_drawing(plan)
    assert claim(bench).job_id == after
    assert bench.job(lost).state == JobState.FAILED


@pytest.mark.parametrize("by_map", [False, True], ids=["keys", "maps of one key"])
def test_who_holds_a_worker_already_gets_no_second_while_others_wait(
    bench: Workbench, plan: Path, *, by_map: bool
) -> None:
    files = many(lambda: bench.add_drawing(plan), FILES)
    first, second = claim(bench), claim(bench)
    with bench.another(key=not by_map):
        theirs = many(lambda: bench.add_drawing(plan), 5)
    assert [first.job_id, second.job_id] == files[:2]
    end(bench, second)
    assert served(bench, 5) == theirs
    assert [claim(bench).job_id, claim(bench).job_id] == files[2:4]


@pytest.mark.parametrize("workers", [2, 4, 8])
def test_of_all_workers_a_key_holds_its_share_while_others_wait(
    bench: Workbench, plan: Path, workers: int
) -> None:
    many(lambda: bench.add_drawing(plan), FILES)
    held = [claim(bench) for _ in range(workers)]
    mine = {attempt.job_id for attempt in held}
    with bench.another():
        theirs = set(many(lambda: bench.add_drawing(plan), FILES))
    for _ in range(3 * workers):
        end(bench, held.pop(0))
        held.append(claim(bench))
    holds = [attempt.job_id in theirs for attempt in held]
    assert sum(holds) == workers // 2
    assert not mine & {attempt.job_id for attempt in held}


def test_what_a_lost_worker_held_is_not_counted_against_its_key(bench: Workbench, plan: Path) -> None:
    lost = bench.add_drawing(plan)
    claim(bench)
    with bench.kernel.db.writing("claim-job") as session:
        session.get_one(Job, lost).lease_until = bench.kernel.now().replace(year=2020)
    with bench.another():
        bench.add_drawing(plan)
        claim(bench)
        bench.add_drawing(plan)
    assert claim(bench).job_id == lost


@pytest.mark.slow
@pytest.mark.parametrize(
    ("workers", "by_map"),
    [(1, False), (2, False), (2, True)],
    ids=["keys, one worker", "keys, two workers", "maps of one key, two workers"],
)
def test_with_real_workers_anothers_build_is_the_next_job(
    bench: Workbench, tmp_path: Path, workers: int, *, by_map: bool
) -> None:
    slow = a_slow_drawing(tmp_path / "slow.png")
    with bench.another(key=not by_map):
        key_id, map_id = bench.key_id, bench.map_id
        drawing = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        with bench.worker():
            assert bench.wait_final(drawing).state == JobState.SUCCEEDED
    files = many(lambda: bench.add_drawing(slow), FILES)
    with bench.worker():
        if workers == 2:
            with bench.worker():
                _build_is_next(bench, key_id, map_id, drawing, files)
            return
        _build_is_next(bench, key_id, map_id, drawing, files)


def _build_is_next(bench: Workbench, key_id: str, map_id: str, drawing: str, files: list[str]) -> None:
    for _ in range(3):
        bench.wait(files[0], lambda job: job.started_at is not None)
        before = bench.key_id, bench.map_id
        bench.key_id, bench.map_id = key_id, map_id
        build = bench.add_revision(drawing)
        bench.key_id, bench.map_id = before
        asked = bench.job(build).created_at
        bench.wait(build, lambda job: job.started_at is not None)
        begun = bench.job(build).started_at
        assert begun is not None
        with bench.kernel.db.reading() as session:
            between = session.scalars(
                select(Job.id).where(
                    Job.kind == JobKind.READ_DRAWING.value, Job.started_at > asked, Job.started_at < begun
                )
            ).all()
        assert len(between) <= 1, between  # one may be claimed in the moment of asking
        bench.wait_final(build)
    waiting = [job for job in files if bench.job(job).state == JobState.QUEUED]
    assert len(waiting) > FILES // 2
