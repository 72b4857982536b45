"""Build a revision (paper, sections 2.2 and 2.3, step 5): the artifacts of a drawing, a recipe and layers."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from service.db.models import Drawing, Revision
from service.domain.drawing_frame import DrawingFrame
from service.domain.drawing_reading import DrawingScale
from service.domain.map_state import ErasedRegion
from service.domain.recipe import Recipe
from service.domain.report import BuildInputs, DrawingInput
from service.storage.blobs import Stored
from service.usecases.map_states import erased_of
from service.usecases.rebuild import record_rebuild
from service.usecases.record_revision import record_revision
from worker.context import JobContext, LayerSource
from worker.formats.artifacts import write_artifacts
from worker.formats.reading import load_walls_and_columns


@dataclass(frozen=True)
class _Inputs:
    """Hold what a revision is derived from, as its rows say."""

    recipe: Recipe
    drawing: DrawingInput
    walls_sha256: str
    scale: DrawingScale
    frame: DrawingFrame | None
    layers: list[LayerSource]
    erased: list[ErasedRegion]

    def told(self) -> BuildInputs:
        """Return the inputs as a report tells them."""
        return BuildInputs(self.drawing, self.scale, [x.input() for x in self.layers], self.erased)


def build_revision(context: JobContext) -> None:
    """Build the revision's artifacts and make it ready.

    1. look up what the revision is made of
    2. load the walls that the drawing's reading found
    3. load each layer's scan and take it to frame `map` by its placement
    4. derive every artifact; the same inputs give the same bytes
    5. keep the files as blobs
    6. make the revision ready with the end of the job
    """
    report, files = _derive(context)
    with context.kernel.db.writing("record-revision") as session:
        record_revision(
            context.kernel,
            session,
            context.attempt,
            report=report,
            version=version("groundplan"),
            files=files,
        )


def rebuild_revision(context: JobContext) -> None:
    """Build a revision's artifacts again, and compare them with what is recorded.

    Raises
    ------
    RebuiltDifferently
        If a file has other bytes than it had.
    """
    _, files = _derive(context)
    with context.kernel.db.writing("record-rebuild") as session:
        record_rebuild(context.kernel, session, context.attempt, version=version("groundplan"), files=files)


def _derive(context: JobContext) -> tuple[dict[str, Any], dict[str, Stored]]:
    """Return the report and the artifacts of the revision that the job is about."""
    inputs = _inputs(context)
    blobs = context.kernel.blobs
    context.progress("load", 0.0)
    walls, columns = load_walls_and_columns(blobs.path(inputs.walls_sha256), bounds=context.bounds)
    layers = [context.load_layer(source) for source in inputs.layers]
    folder = context.folder("artifacts")
    paths = write_artifacts(
        folder,
        walls=walls,
        columns=columns,
        recipe=inputs.recipe,
        inputs=inputs.told(),
        drawing=inputs.frame,
        layers=layers,
        erased=[one.region for one in inputs.erased if one.drawing],
        bounds=context.bounds,
        progress=lambda stage, share: context.progress(stage, 0.1 + 0.8 * share),
    )
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    context.progress("store", 0.95)
    return report, {str(path.relative_to(folder)): blobs.adopt(path) for path in paths}


def _inputs(context: JobContext) -> _Inputs:
    layers = context.layer_sources(context.attempt.subject_id)
    with context.kernel.db.reading() as session:
        revision = session.get_one(Revision, context.attempt.subject_id)
        drawing = session.get_one(Drawing, revision.drawing_id)
        named = DrawingInput(drawing.blob_sha256, drawing.id, revision.walls_sha256)
        return _Inputs(
            recipe=Recipe.from_json(revision.recipe),
            drawing=named,
            walls_sha256=revision.walls_sha256,
            scale=DrawingScale.of_row(revision.scale),
            frame=DrawingFrame.of_reading(revision.drawing_frame),
            layers=layers,
            erased=list(erased_of(revision)),
        )
