"""Compare two revisions of a map: what they are made of, and what lies where; a job compares the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from service.db.comparisons import Comparison, find_comparison
from service.db.job_lists import find_job
from service.db.jobs import Attempt, enqueue, finish_succeeded
from service.db.maps import find_map
from service.db.models import Job, Revision
from service.db.session import Session
from service.domain.access import Actor
from service.domain.comparison import CloudComparison
from service.domain.errors import ArtifactNotFound
from service.domain.lifecycle import JobKind
from service.domain.map_state import Difference, differences
from service.storage.blobs import Stored
from service.usecases.download import StoredFile, stored_file
from service.usecases.kernel import Kernel
from service.usecases.map_states import state_of
from service.usecases.record_files import record_files
from service.usecases.revisions import ready_revision

PICTURE = "comparison.png"


@dataclass(frozen=True)
class Compared:
    """Hold in what two revisions differ.

    Parameters
    ----------
    differences : sequence of Difference
        The drawing, the recipe, layers and erased regions.
    geometry : dict or None
        Points and tiles added and removed; None until the job has ended well.
    job : Job
        What compares the points, or did.
    """

    from_n: int
    to_n: int
    differences: Sequence[Difference]
    geometry: dict[str, Any] | None
    job: Job


def compare(kernel: Kernel, actor: Actor, *, map_id: str, n: int, with_n: int) -> Compared:
    """Return what changed from revision `with_n` to revision `n`; the first who asks begins the job.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady, RevisionPruned
        As `ready_revision`, for either revision.
    StorageFull
        If there is no room for what its job makes.
    """
    with kernel.db.reading() as session:
        old, new = (ready_revision(session, actor, map_id=map_id, n=k) for k in (with_n, n))
        found = find_comparison(session, from_id=old.id, to_id=new.id)
    if found is None:
        _ask(kernel, actor, map_id, from_id=old.id, to_id=new.id)
    with kernel.db.reading() as session:
        return _compared(session, session.get_one(Revision, old.id), session.get_one(Revision, new.id))


def comparison_picture(kernel: Kernel, actor: Actor, *, map_id: str, n: int, with_n: int) -> StoredFile:
    """Return the picture of a comparison that was made.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady, RevisionPruned
        As `ready_revision`, for either revision.
    ArtifactNotFound
        If nobody asked for the comparison yet, or it is being made.
    """
    with kernel.db.reading() as session:
        old, new = (ready_revision(session, actor, map_id=map_id, n=k) for k in (with_n, n))
        found = find_comparison(session, from_id=old.id, to_id=new.id)
        if found is None or found.picture_sha256 is None:
            raise ArtifactNotFound("There is no picture yet: ask for the comparison, and wait for its job.")
        return stored_file(kernel, session, sha256=found.picture_sha256, file_name=PICTURE)


def record_comparison(
    kernel: Kernel, session: Session, attempt: Attempt, *, geometry: CloudComparison, picture: Stored
) -> None:
    """Keep a comparison that was made, in one transaction with the end of its job.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    finish_succeeded(session, attempt, now=kernel.now())
    record_files(kernel, session, {PICTURE: picture})
    row = session.get_one(Comparison, attempt.subject_id)
    row.geometry, row.picture_sha256 = geometry.to_json(), picture.sha256


def _ask(kernel: Kernel, actor: Actor, map_id: str, *, from_id: str, to_id: str) -> None:
    with kernel.db.writing("ask-comparison") as session:
        find_map(session, map_id, lock=True)
        if find_comparison(session, from_id=from_id, to_id=to_id) is not None:
            return
        kernel.room.require()
        now, comparison_id = kernel.now(), kernel.new_id("cmp")
        job = enqueue(
            session,
            JobKind.COMPARE_REVISIONS,
            job_id=kernel.new_id("job"),
            map_id=map_id,
            subject_id=comparison_id,
            key_id=actor.key_id,
            now=now,
        )
        row = Comparison(
            id=comparison_id, from_revision_id=from_id, to_revision_id=to_id, job_id=job.id, created_at=now
        )
        session.add(row)


def _compared(session: Session, old: Revision, new: Revision) -> Compared:
    found = find_comparison(session, from_id=old.id, to_id=new.id)
    assert found is not None
    job = find_job(session, found.job_id)
    assert job is not None
    told = differences(state_of(session, old), state_of(session, new))
    return Compared(old.n, new.n, told, found.geometry, job)
