"""Make an export: a revision's cloud in another format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from service.db.exports import Export
from service.db.revisions import find_artifact
from service.domain.lifecycle import ExportFormat
from service.usecases.download import CLOUD_PATH
from service.usecases.exports import record_export
from worker.context import JobContext
from worker.formats.export import write_laz, write_ply
from worker.formats.pcd import read_pcd
from worker.geometry.cloud.point_cloud import PointCloud

_WRITERS: Mapping[ExportFormat, Callable[[Path, PointCloud], None]] = {
    ExportFormat.LAZ: write_laz,
    ExportFormat.PLY: write_ply,
}


def export_cloud(context: JobContext) -> None:
    """Write the export, keep it as a blob, and record it with the end of the job."""
    blobs = context.kernel.blobs
    with context.kernel.db.reading() as session:
        row = session.get_one(Export, context.attempt.subject_id)
        kind = ExportFormat(row.format)
        artifact = find_artifact(session, row.revision_id, path=CLOUD_PATH)
        assert artifact is not None
        source = blobs.path(artifact.sha256)
    context.progress("load", 0.1)
    cloud = read_pcd(source, context.bounds)
    context.progress("write", 0.3)
    path = context.folder("export") / f"cloud.{kind.value}"
    _WRITERS[kind](path, cloud)
    context.progress("store", 0.9)
    stored = blobs.adopt(path)
    with context.kernel.db.writing("record-export") as session:
        record_export(context.kernel, session, context.attempt, stored=stored)
