"""Give a robot what a revision's cloud adds to the one that it holds; made once, by a job."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from pathlib import Path

from service.db.blobs import blob_size, record_blob
from service.db.deltas import Delta, find_delta, is_cloud_of, is_wanted_cloud, waiting_deltas
from service.db.job_lists import find_job
from service.db.jobs import Attempt, enqueue, finish_succeeded
from service.db.maps import find_map
from service.db.revisions import find_artifact, find_revision
from service.db.session import Session
from service.domain.access import Actor
from service.domain.dictionary import is_window_taken
from service.domain.errors import (
    ArtifactNotFound,
    DeltaNotOffered,
    DeltaNotReady,
    TooManyDeltas,
    Unavailable,
)
from service.domain.lifecycle import MOST_WAITING_DELTAS, JobKind, JobState, Role
from service.storage.blobs import Stored
from service.usecases.download import CLOUD_PATH, CodedForm, StoredFile
from service.usecases.kernel import Kernel
from service.usecases.maps import covered_map
from service.usecases.revisions import ready_revision

MEDIA_TYPE = "application/zstd"
_RETRY_S, _RETRY_MANY_S, _RETRY_FAILED_S = 1, 300, 3600
_READ_BYTES = 1 << 20
_DCZ_MAGIC = bytes.fromhex("5e2a4d1820000000")


def delta_file(kernel: Kernel, actor: Actor, *, map_id: str, n: int, from_n: int) -> StoredFile:
    """Return what the cloud of revision `n` adds to that of revision `from_n`, as a zstd frame.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady
        As `ready_revision`, for either revision.
    ArtifactNotFound
        If one of them has no cloud.
    DeltaNotReady
        If it has still to be made: this call has asked for it; or if its job failed.
    DeltaNotOffered
        If nobody made it yet, and none is made for this key: no robot is to have revision `n`.
    TooManyDeltas, StorageFull
        As `ask_for_delta`.
    """
    with kernel.db.reading() as session:
        old, new = (_cloud_sha256(session, actor, map_id=map_id, n=k) for k in (from_n, n))
        found = find_delta(session, from_sha256=old, to_sha256=new)
        if found is None and not _may_begin(session, actor, map_id, to_sha256=new):
            raise DeltaNotOffered(
                f"No delta from revision {from_n} to {n} was made yet, and for this key none is: no channel "
                f"points to revision {n}. Take the changed tiles, or the whole file."
            )
        if found is not None and found.sha256 is not None:
            return _file(kernel, found, name=f"revision-{from_n}-to-{n}.zst")
        job = None if found is None else find_job(session, found.job_id)
    if job is not None and job.state in {JobState.FAILED, JobState.CANCELLED}:
        raise DeltaNotReady(
            f"The delta could not be made; its job is {job.id}. Take the changed tiles, or the whole file.",
            job_id=job.id,
            retry_after_s=_RETRY_FAILED_S,
        )
    job_id = job.id if job else ask_for_delta(kernel, actor, map_id=map_id, from_sha256=old, to_sha256=new)
    raise DeltaNotReady(
        "The delta is being made; ask again in a moment.", job_id=job_id, retry_after_s=_RETRY_S
    )


def ask_for_delta(kernel: Kernel, actor: Actor, *, map_id: str, from_sha256: str, to_sha256: str) -> str:
    """Return the id of the job that makes or made the delta; the first who asks begins it, in its own turn.

    Raises
    ------
    StorageFull
        If there is no room for what it makes.
    TooManyDeltas
        If as many of the map's have still to be made as may wait.
    """
    kernel.room.require()
    with kernel.db.writing("ask-delta") as session:
        find_map(session, map_id, lock=True)
        found = find_delta(session, from_sha256=from_sha256, to_sha256=to_sha256)
        if found is not None:
            return found.job_id
        if waiting_deltas(session, map_id, foreseen=False) >= MOST_WAITING_DELTAS:
            raise TooManyDeltas(
                f"{MOST_WAITING_DELTAS} deltas of this map have still to be made. Take the changed tiles or "
                "the whole file, or ask again later.",
                max_waiting_deltas=MOST_WAITING_DELTAS,
                retry_after_s=_RETRY_MANY_S,
            )
        return _begin(
            kernel, session, map_id, from_sha256=from_sha256, to_sha256=to_sha256, key_id=actor.key_id
        )


def foresee_delta(kernel: Kernel, session: Session, map_id: str, *, from_n: int, to_n: int) -> None:
    """Begin the delta that robots will ask for when a channel moves from one revision to another.

    In the transaction of the move, which holds the map. Where one of them has no cloud, or both have the
    same, there is nothing to make; where as many as may wait are foreseen already, robots ask for it.
    """
    clouds = []
    for n in (from_n, to_n):
        revision = find_revision(session, map_id, n=n)
        found = None if revision is None else find_artifact(session, revision.id, path=CLOUD_PATH)
        clouds.append(None if found is None else found.sha256)
    old, new = clouds
    if old is None or new is None or old == new:
        return
    if find_delta(session, from_sha256=old, to_sha256=new) is not None:
        return
    if waiting_deltas(session, map_id, foreseen=True) < MOST_WAITING_DELTAS:
        _begin(kernel, session, map_id, from_sha256=old, to_sha256=new, key_id=None)


def _may_begin(session: Session, actor: Actor, map_id: str, *, to_sha256: str) -> bool:
    """Return whether a delta into this cloud is made for the key: an admin's, or one for what robots need."""
    if actor.role is Role.ADMIN:
        return True
    return is_wanted_cloud(session, map_id, path=CLOUD_PATH, sha256=to_sha256, key_id=actor.key_id)


def _begin(
    kernel: Kernel, session: Session, map_id: str, *, from_sha256: str, to_sha256: str, key_id: str | None
) -> str:
    """Return the id of the job of a new delta, of a map that this transaction holds; it is the key's."""
    now, delta_id = kernel.now(), kernel.new_id("dlt")
    job = enqueue(
        session,
        JobKind.MAKE_DELTA,
        job_id=kernel.new_id("job"),
        map_id=map_id,
        subject_id=delta_id,
        key_id=key_id,
        now=now,
    )
    session.add(
        Delta(id=delta_id, from_sha256=from_sha256, to_sha256=to_sha256, job_id=job.id, created_at=now)
    )
    return job.id


def dictionary_form(
    kernel: Kernel, actor: Actor, *, map_id: str, held_sha256: str, wanted_sha256: str
) -> CodedForm | None:
    """Return the cloud `wanted_sha256` as what it adds to the one that the robot holds, if that is made.

    If it is not, the robot holds a cloud of the same map, and the key may have it made, this call has asked
    for it. What a client of the coding may refuse for its window is never given: such a robot takes the delta
    as a file, or the tiles.

    Raises
    ------
    MapNotFound
        If there is no such map for the key.
    """
    with kernel.db.reading() as session:
        covered_map(session, actor, map_id=map_id)
        held_bytes, wanted_bytes = (
            blob_size(session, sha256) or 0 for sha256 in (held_sha256, wanted_sha256)
        )
        if not is_window_taken(held_bytes, content_bytes=wanted_bytes):
            return None
        found = find_delta(session, from_sha256=held_sha256, to_sha256=wanted_sha256)
        if found is not None:
            return _form(kernel, found)
        may_begin = is_cloud_of(session, map_id, path=CLOUD_PATH, sha256=held_sha256) and _may_begin(
            session, actor, map_id, to_sha256=wanted_sha256
        )
    if may_begin:
        with suppress(Unavailable):  # the file itself goes out all the same
            ask_for_delta(kernel, actor, map_id=map_id, from_sha256=held_sha256, to_sha256=wanted_sha256)
    return None


def record_delta(
    kernel: Kernel, session: Session, attempt: Attempt, *, stored: Stored, coded_sha256: str
) -> None:
    """Keep a delta that was made, in one transaction with the end of its job.

    Parameters
    ----------
    stored : Stored
        The delta, in the blob store already.
    coded_sha256 : str
        What `dcz_sha256` gives of it.

    Raises
    ------
    LeaseLost
        If the job is no longer this attempt's: nothing is recorded.
    """
    now = kernel.now()
    finish_succeeded(session, attempt, now=now)
    record_blob(session, stored.sha256, size_bytes=stored.size_bytes, media_type=MEDIA_TYPE, now=now)
    row = session.get_one(Delta, attempt.subject_id)
    row.sha256, row.size_bytes, row.coded_sha256 = stored.sha256, stored.size_bytes, coded_sha256


def dcz_sha256(from_sha256: str, delta: Path) -> str:
    """Return the SHA-256 (hex) of a delta as it goes out under the coding `dcz`."""
    digest = hashlib.sha256(_dcz_head(from_sha256))
    with delta.open("rb") as file:
        while chunk := file.read(_READ_BYTES):
            digest.update(chunk)
    return digest.hexdigest()


def _cloud_sha256(session: Session, actor: Actor, *, map_id: str, n: int) -> str:
    revision = ready_revision(session, actor, map_id=map_id, n=n)
    found = find_artifact(session, revision.id, path=CLOUD_PATH)
    if found is None:
        raise ArtifactNotFound(f"Revision {n} has no {CLOUD_PATH}.")
    return found.sha256


def _file(kernel: Kernel, row: Delta, *, name: str) -> StoredFile:
    assert row.sha256 is not None
    assert row.size_bytes is not None
    return StoredFile(kernel.blobs.path(row.sha256), row.sha256, row.size_bytes, MEDIA_TYPE, name)


def _form(kernel: Kernel, row: Delta) -> CodedForm | None:
    if row.sha256 is None or row.size_bytes is None or row.coded_sha256 is None:
        return None
    head = _dcz_head(row.from_sha256)
    path = kernel.blobs.path(row.sha256)
    return CodedForm("dcz", path, row.coded_sha256, row.size_bytes + len(head), head)


def _dcz_head(from_sha256: str) -> bytes:
    """Return what stands before the frame in `dcz`: the dictionary's SHA-256, as RFC 9842 has it."""
    return _DCZ_MAGIC + bytes.fromhex(from_sha256)
