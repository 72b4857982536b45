"""Read a drawing (paper, section 2.2, steps 1 and 2): its walls, and what was removed."""

from __future__ import annotations

import json
from pathlib import Path

from service.db.models import Drawing
from service.domain.drawing_options import DrawingOptions
from service.usecases.record_drawing_reading import record_drawing_reading
from worker.context import JobContext
from worker.formats.drawing import read_drawing_file
from worker.formats.reading import write_reading
from worker.formats.sheet_tiles import write_sheet_tiles
from worker.geometry.drawing.raster.sheet import Sheet


def read_drawing(context: JobContext) -> None:
    """Read the drawing and record its reading.

    1. take the uploaded bytes and what was said of their scale and page; write a sheet's pixels as tiles
    2. find walls and columns, and set aside the rest with its reason
    3. write the reading's files and keep them as blobs
    4. record the reading with the end of the job
    """
    path, options = _uploaded(context)
    context.begin_reading(path)
    folder = context.folder("reading")
    names = ["walls.geojson", "removed.geojson", "preview.png"]

    def keep_pixels(sheet: Sheet) -> None:
        names.extend(file.name for file in write_sheet_tiles(folder, sheet.grey))

    reading = read_drawing_file(
        path,
        options=options,
        bounds=context.bounds,
        progress=lambda stage, share: context.progress(stage, 0.9 * share),
        seen=keep_pixels,
    )
    context.progress("write", 0.9)
    write_reading(reading, folder)
    summary = json.loads((folder / "reading.json").read_text(encoding="utf-8"))
    blobs = context.kernel.blobs
    files = {name: blobs.adopt(folder / name) for name in names}
    with context.kernel.db.writing("record-drawing-reading") as session:
        record_drawing_reading(context.kernel, session, context.attempt, reading=summary, files=files)


def _uploaded(context: JobContext) -> tuple[Path, DrawingOptions]:
    with context.kernel.db.reading() as session:
        drawing = session.get_one(Drawing, context.attempt.subject_id)
        path = context.uploaded(drawing.blob_sha256, drawing.file_name)
        return path, DrawingOptions.from_json(drawing.options)
