"""Make a delta: what one cloud adds to another."""

from __future__ import annotations

from service.db.deltas import Delta
from service.usecases.deltas import dcz_sha256, record_delta
from worker.context import JobContext
from worker.formats.delta import write_delta


def make_delta(context: JobContext) -> None:
    """Write the delta, keep it as a blob, and record it with the end of the job."""
    blobs = context.kernel.blobs
    with context.kernel.db.reading() as session:
        row = session.get_one(Delta, context.attempt.subject_id)
        from_sha256 = row.from_sha256
        old, new = blobs.path(row.from_sha256), blobs.path(row.to_sha256)
    context.progress("compress", 0.1)
    delta = context.folder("delta") / "delta.zst"
    write_delta(delta, old=old, new=new)
    context.progress("store", 0.9)
    coded_sha256 = dcz_sha256(from_sha256, delta)
    stored = blobs.adopt(delta)
    with context.kernel.db.writing("record-delta") as session:
        record_delta(context.kernel, session, context.attempt, stored=stored, coded_sha256=coded_sha256)
