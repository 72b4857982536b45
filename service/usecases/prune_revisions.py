"""Let go the files of old revisions that nothing needs: what they are made of stays, and makes them again."""

from __future__ import annotations

from service.db.maps import find_map
from service.db.retention import crowded_maps, forget_blobs, prunable, prune
from service.usecases.audit import record
from service.usecases.kernel import Kernel


def prune_revisions(kernel: Kernel, *, keep: int) -> int:
    """Return how many revisions let their files go: those older than the newest `keep` of their map.

    Never those that a channel points to or would roll back to, that a robot runs, or that a job works on.
    A map at a time, each in a transaction of its own; 0 keeps all.
    """
    if keep < 1:
        return 0
    with kernel.db.reading() as session:
        maps = crowded_maps(session, keep=keep)
    return sum(_prune_map(kernel, map_id, keep) for map_id in maps)


def _prune_map(kernel: Kernel, map_id: str, keep: int) -> int:
    with kernel.db.writing("prune-revisions") as session:
        find_map(session, map_id, lock=True)
        revisions = prunable(session, map_id, keep=keep)
        blobs: set[str] = set()
        for revision in revisions:
            blobs |= set(prune(session, revision, now=kernel.now()))
            record(
                kernel,
                session,
                None,
                action="prune-revision",
                subject_id=revision.id,
                map_id=map_id,
                after={"n": revision.n},
            )
        forget_blobs(session, sorted(blobs))
        return len(revisions)
