"""Make room: what crashes and given-up uploads left behind."""

from __future__ import annotations

from dataclasses import dataclass

from service.db.blobs import is_recorded
from service.storage.pieces import PieceStore
from service.usecases.answer import forget_answers
from service.usecases.kernel import Kernel
from service.usecases.prune_revisions import prune_revisions
from service.usecases.resumable_upload import forget_uploads, sweep_uploads


@dataclass(frozen=True)
class Swept:
    """Hold how many things of each kind were removed."""

    revisions: int
    staged_files: int
    orphan_blobs: int
    uploads: int


def sweep_storage(
    kernel: Kernel, pieces: PieceStore, *, idempotency_expiry_s: float, keep_revisions: int = 0
) -> Swept:
    """Return what was removed: staged files of dead processes, blobs without a row, dead uploads.

    Safe at any time and in any number of processes at once: a blob without a row is an orphan only when
    it is more than an hour old, since bytes come first and rows second. Answers that no repeated request
    can ask for any more are forgotten too, and old revisions let their files go as `prune_revisions` has it.
    Files go first: that makes room for the rest where the disk is full.
    """
    now_s = kernel.now().timestamp()

    def is_known(sha256: str) -> bool:
        with kernel.db.reading() as session:
            return is_recorded(session, sha256)

    staged_files = len(kernel.blobs.sweep_staged(now_s=now_s))
    uploads = len(sweep_uploads(kernel, pieces))
    orphan_blobs = len(kernel.blobs.sweep_orphans(is_known, now_s=now_s))
    forget_uploads(kernel)
    forget_answers(kernel, older_than_s=idempotency_expiry_s)
    return Swept(prune_revisions(kernel, keep=keep_revisions), staged_files, orphan_blobs, uploads)
