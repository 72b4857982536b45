from __future__ import annotations

import time
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select, text
from sqlalchemy.orm import Session

from service.db import jobs, waiting
from service.db.delivery import redeliver_lost
from service.db.jobs import Attempt, LeaseLost
from service.db.models import Job, Revision
from service.domain.errors import JobNotCancellable, JobNotRetryable, StorageFull
from service.domain.lifecycle import MAX_ATTEMPTS, MOST_FULL_TRIES, JobState
from service.storage.room import Space
from tests.worker.workbench import Workbench, a_small_drawing

PROBLEM: dict[str, Any] = {"slug": "file-truncated", "title": "The file is cut short", "detail": "It ends."}


@pytest.fixture
def job_id(bench: Workbench, tmp_path: Path) -> str:
    return bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))


def claim(bench: Workbench, *, lease_s: float = 60.0, worker: str = "w") -> Attempt | None:
    with bench.kernel.db.writing("claim-job") as session:
        return jobs.claim(
            session,
            worker=worker,
            token=bench.kernel.new_id("att"),
            lease_s=lease_s,
            now=bench.kernel.now(),
        )


def claimed(bench: Workbench, *, lease_s: float = 60.0) -> Attempt:
    attempt = claim(bench, lease_s=lease_s)
    assert attempt is not None
    return attempt


def let_expire(bench: Workbench) -> Attempt:
    attempt = claimed(bench, lease_s=0.001)
    time.sleep(0.01)
    return attempt


def write(bench: Workbench, act: Any) -> Any:
    with bench.kernel.db.writing("end-job") as session:
        return act(session, bench.kernel.now())


def deliveries(bench: Workbench, status: str = "todo") -> list[str]:
    wanted = text(
        "SELECT args->>'job_id' FROM procrastinate_jobs"
        " WHERE status = CAST(:s AS text)::procrastinate_job_status"
    )
    with bench.kernel.db.reading() as session:
        return list(session.scalars(wanted, {"s": status}))


def test_a_job_is_claimed_once(bench: Workbench, job_id: str) -> None:
    first, second = claim(bench), claim(bench)
    assert first is not None
    assert (first.job_id, first.attempt, second) == (job_id, 1, None)
    assert bench.job(job_id).state == JobState.RUNNING


def test_a_job_that_expired_is_taken_over_and_its_first_attempt_can_do_nothing_more(
    bench: Workbench, job_id: str
) -> None:
    lost = let_expire(bench)
    heir = claimed(bench)
    assert (heir.job_id, heir.attempt) == (job_id, 2)
    now = bench.kernel.now
    before = bench.job(job_id).changed
    late: list[Any] = [
        lambda s: jobs.beat(s, lost, lease_s=9.0, now=now()),
        lambda s: jobs.finish_succeeded(s, lost, now=now()),
        lambda s: jobs.finish_failed(s, lost, problem=PROBLEM, now=now()),
        lambda s: jobs.finish_cancelled(s, lost, now=now()),
        lambda s: jobs.try_again(s, lost, problem=PROBLEM, now=now()),
        lambda s: waiting.give_back(s, lost, now=now()),
        lambda s: waiting.wait_for_room(s, lost, problem=PROBLEM, last=PROBLEM, wait_s=0.0, now=now()),
    ]
    for act in late:
        with pytest.raises(LeaseLost), bench.kernel.db.writing("end-job") as session:
            act(session)
    job = bench.job(job_id)
    assert (job.state, job.attempt_token, job.changed) == (JobState.RUNNING, heir.token, before)


def test_a_beat_keeps_the_lease_and_tells_of_a_cancel(bench: Workbench, job_id: str) -> None:
    attempt = claimed(bench, lease_s=0.5)
    assert not write(bench, lambda s, now: jobs.beat(s, attempt, lease_s=60.0, now=now))
    time.sleep(0.6)
    assert claim(bench) is None
    write(bench, lambda s, now: jobs.request_cancel(s, job_id, now=now))
    assert write(
        bench, lambda s, now: jobs.beat(s, attempt, lease_s=60.0, now=now, stage="ink", fraction=0.5)
    )
    job = bench.job(job_id)
    assert (job.stage, job.fraction, job.state) == ("ink", 0.5, JobState.RUNNING)


def test_back_off_grows_and_the_third_death_is_the_last(bench: Workbench, job_id: str) -> None:
    waits = []
    for number in range(1, MAX_ATTEMPTS + 1):
        with bench.kernel.db.writing("beat-job") as session:
            session.get_one(Job, job_id).run_after = bench.kernel.now().replace(year=2020)
        attempt = claimed(bench)
        assert attempt.attempt == number
        problem = jobs.crashed(attempts=number, last="killed by signal 9 (SIGKILL)").problem()
        again = write(bench, lambda s, now: jobs.try_again(s, attempt, problem=problem, now=now))  # noqa: B023
        assert again == (number < MAX_ATTEMPTS)
        if again:
            waits.append((bench.job(job_id).run_after - bench.kernel.now()).total_seconds())
    assert 0.5 < waits[0] <= 1.0
    assert 4.0 < waits[1] <= 5.0
    job = bench.job(job_id)
    assert job.state == JobState.FAILED
    assert job.problem is not None
    assert (job.problem["slug"], job.problem["attempts"]) == ("job-crashed", 3)
    assert "signal 9" in job.problem["last"]


def test_a_worker_lost_three_times_ends_the_job(bench: Workbench, job_id: str) -> None:
    for _ in range(MAX_ATTEMPTS):
        let_expire(bench)
    assert claim(bench) is None
    job = bench.job(job_id)
    assert job.state == JobState.FAILED
    assert job.problem is not None
    assert (job.problem["slug"], job.problem["attempts"]) == ("job-crashed", 3)


@pytest.mark.parametrize("problem", [None, PROBLEM], ids=["stopped", "without room from the start"])
def test_what_is_given_back_does_not_count_as_a_try(
    bench: Workbench, job_id: str, problem: dict[str, Any] | None
) -> None:
    for _ in range(2 * max(MAX_ATTEMPTS, MOST_FULL_TRIES)):
        attempt = claimed(bench)
        write(bench, lambda s, now: waiting.give_back(s, attempt, problem=problem, now=now))  # noqa: B023
        assert bench.job(job_id).problem == problem
    job = bench.job(job_id)
    assert (job.attempt, job.full_tries) == (0, 0)
    assert claimed(bench).attempt == 1


def test_a_job_that_fills_the_disk_waits_a_few_times_and_then_fails(bench: Workbench, job_id: str) -> None:
    full = StorageFull("It is full.").problem()
    last = Space("data", 5, 3).did_not_do(MOST_FULL_TRIES).problem()
    again: Any = {"problem": full, "last": last}

    def fill(*, wait_s: float = 0.0) -> bool:
        attempt = claimed(bench)
        assert attempt.attempt == 1, "such tries are no attempts"
        told = again | {"wait_s": wait_s}
        waits: bool = write(bench, lambda s, now: waiting.wait_for_room(s, attempt, **told, now=now))
        return waits

    for tries in range(1, MOST_FULL_TRIES):
        assert fill()
        job = bench.job(job_id)
        assert (job.state, job.problem, job.full_tries) == (JobState.QUEUED, full, tries)
    assert not fill(wait_s=60.0)
    job = bench.job(job_id)
    assert (job.state, job.problem) == (JobState.FAILED, last)
    assert (last["slug"], last["tries"], last["free_bytes"]) == ("storage-full", MOST_FULL_TRIES, 5)
    assert claim(bench) is None
    write(bench, lambda s, now: jobs.retry(s, job_id, now=now))
    assert fill(wait_s=60.0), "who has made room gets all tries anew"
    assert bench.job(job_id).full_tries == 1
    assert claim(bench) is None, "it waits"


def test_cancel_ends_what_waits_marks_what_runs_and_refuses_what_has_ended(
    bench: Workbench, job_id: str
) -> None:
    attempt = claimed(bench)
    write(bench, lambda s, now: jobs.request_cancel(s, job_id, now=now))
    assert bench.job(job_id).state == JobState.RUNNING
    write(bench, lambda s, now: jobs.finish_cancelled(s, attempt, now=now))
    assert bench.job(job_id).state == JobState.CANCELLED
    with pytest.raises(JobNotCancellable):
        write(bench, lambda s, now: jobs.request_cancel(s, job_id, now=now))
    write(bench, lambda s, now: jobs.retry(s, job_id, now=now))
    write(bench, lambda s, now: jobs.request_cancel(s, job_id, now=now))
    assert bench.job(job_id).state == JobState.CANCELLED
    assert claim(bench) is None


def test_a_lost_job_that_was_to_be_cancelled_is_not_run_again(bench: Workbench, job_id: str) -> None:
    let_expire(bench)
    write(bench, lambda s, now: jobs.request_cancel(s, job_id, now=now))
    assert claim(bench) is None
    assert bench.job(job_id).state == JobState.CANCELLED


def test_retry_is_for_what_failed(bench: Workbench, job_id: str) -> None:
    with pytest.raises(JobNotRetryable):
        write(bench, lambda s, now: jobs.retry(s, job_id, now=now))
    attempt = claimed(bench)
    write(bench, lambda s, now: jobs.finish_failed(s, attempt, problem=PROBLEM, now=now))
    assert bench.job(job_id).problem == PROBLEM
    write(bench, lambda s, now: jobs.retry(s, job_id, now=now))
    job = bench.job(job_id)
    assert (job.state, job.attempt, job.problem, job.ended_at) == (JobState.QUEUED, 0, None, None)
    assert claimed(bench).attempt == 1


@pytest.mark.parametrize("end", ["failed", "cancelled"])
def test_a_revision_fails_with_its_job_and_stays_failed(bench: Workbench, job_id: str, end: str) -> None:
    write(bench, lambda s, now: jobs.finish_succeeded(s, claimed_of(s, bench, job_id), now=now))
    build = bench.add_revision(job_id)
    attempt = claimed(bench)
    if end == "failed":
        write(bench, lambda s, now: jobs.finish_failed(s, attempt, problem=PROBLEM, now=now))
    else:
        write(bench, lambda s, now: jobs.finish_cancelled(s, attempt, now=now))
    with bench.kernel.db.reading() as session:
        revision = session.scalars(select(Revision).where(Revision.job_id == build)).one()
        assert revision.status == "failed"
        assert revision.ended_at is not None
    with pytest.raises(JobNotRetryable):
        write(bench, lambda s, now: jobs.retry(s, build, now=now))


def claimed_of(session: Session, bench: Workbench, job_id: str) -> Attempt:
    now: datetime = bench.kernel.now()
    attempt = jobs.claim(
        session, worker="w", token=bench.kernel.new_id("att"), lease_s=60.0, now=now, job_id=job_id
    )
    assert attempt is not None
    return attempt


def test_the_oldest_due_job_comes_first(bench: Workbench, job_id: str, tmp_path: Path) -> None:
    later = bench.add_drawing(a_small_drawing(tmp_path / "second.png"))
    assert [claimed(bench).job_id, claimed(bench).job_id] == [job_id, later]


def test_a_rolled_back_request_leaves_neither_job_nor_delivery(bench: Workbench) -> None:
    def enqueue_and_fail(session: Session, now: datetime) -> None:
        jobs.enqueue(
            session,
            jobs.JobKind.READ_SCAN,
            job_id="job_x",
            map_id=bench.map_id,
            subject_id="scn_x",
            key_id=bench.key_id,
            now=now,
        )
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write(bench, enqueue_and_fail)
    with bench.kernel.db.reading() as session:
        assert session.get(Job, "job_x") is None
    if not bench.kernel.db.is_sqlite:
        assert deliveries(bench) == []


def test_on_postgresql_a_job_is_delivered_and_a_lost_delivery_is_made_anew(
    bench: Workbench, job_id: str
) -> None:
    if bench.kernel.db.is_sqlite:
        assert is_any_due(bench)
        return
    assert deliveries(bench) == [job_id]
    look = lambda s, _now: redeliver_lost(s, now=bench.kernel.now)  # noqa: E731
    assert write(bench, look) == []
    with bench.kernel.db.writing("end-job") as session:
        session.execute(text("DELETE FROM procrastinate_jobs"))
    assert write(bench, look) == []  # it became due just now: its delivery may be on the way
    let_expire(bench)
    assert write(bench, look) == [job_id]
    assert write(bench, look) == []
    assert deliveries(bench) == [job_id]


def is_any_due(bench: Workbench) -> bool:
    with bench.kernel.db.reading() as session:
        return jobs.any_due(session, now=bench.kernel.now())
