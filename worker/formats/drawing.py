"""Any drawing file to its reading: the one way that the command line and the jobs take."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from worker.formats.raster import load_raster
from worker.geometry.drawing.read import read_raster
from worker.geometry.drawing.reading import Reading
from worker.geometry.drawing.scale import Scale, given

Progress = Callable[[str, float], None]


def read_drawing_file(
    path: Path, *, options: DrawingOptions, bounds: Bounds | None = None, progress: Progress | None = None
) -> Reading:
    """Return the reading of a drawing file; what kind it is, its own bytes tell.

    Parameters
    ----------
    path : Path
        The file as it was uploaded.
    options : DrawingOptions
        What a person said of it: scale, page.
    bounds : Bounds, optional
        The most that is read.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`.

    Raises
    ------
    Rejected
        If the file cannot be read; the leaf tells why.
    NoWallsFound
        If nothing in it looks like a wall.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("load", 0.0)
    grey = load_raster(path, bounds=bounds, page=options.page)
    scale = Scale("unknown", None) if options.scale is None else given(options.scale.metres_per_px())
    return read_raster(grey, scale=scale, progress=tell)
