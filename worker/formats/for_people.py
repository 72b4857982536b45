"""What of a revision is for people and viewers alone: the map is whole without it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from service.domain.errors import DomainError
from service.domain.findings import Finding
from worker.formats import preview
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.drawing.reading.reading import Column, Wall


def write_what_can_be(
    directory: Path, makers: Mapping[tuple[str, ...], Callable[[], object]]
) -> tuple[list[Path], list[Finding]]:
    """Return the files that could be made, and a finding for each that could not.

    Parameters
    ----------
    directory : Path
        Where the makers write.
    makers : mapping of tuple of str to callable
        What makes the files of these names, in the order of making.

    Returns
    -------
    list of Path
        Of a maker that failed no file stays.
    list of Finding
        ``file-not-made``, with the names of the files.

    Notes
    -----
    A full or broken disk, too little memory and a refusal are no faults of one file: they are raised.
    """
    paths: list[Path] = []
    findings: list[Finding] = []
    for names, make in makers.items():
        own = [directory / name for name in names]
        try:
            make()
        except (DomainError, MemoryError):
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            for path in own:
                path.unlink(missing_ok=True)
            findings.append(_not_made(names, error))
        else:
            paths += own
    return paths, findings


def _not_made(names: tuple[str, ...], error: Exception) -> Finding:
    what = " and ".join(names)
    why = f"{type(error).__name__}: {error}"[:500]
    message = f"{what} could not be made ({why}). It is for people alone: the map is whole without it."
    return Finding("file-not-made", "warning", message, {"files": list(names)})


def write_picture(path: Path, walls: Sequence[Wall], columns: Sequence[Column], cloud: PointCloud) -> None:
    """Write the map from above: walls, columns, and the points of layers."""
    lines = [f for w in walls for f in w.faces] + [c.outline for c in columns]
    layer_points = cloud.points[cloud.labels == Label.LAYER, :2]
    every = np.vstack([*lines, layer_points])
    drawn = [
        preview.Drawn(
            preview.COLUMN, lines=tuple(np.vstack([c.outline, c.outline[:1]]) for c in columns), width=2
        ),
        preview.Drawn(preview.WALL, lines=tuple(f for w in walls for f in w.faces), width=2),
        preview.Drawn(preview.LAYER, points=layer_points),
    ]
    low, high = every.min(axis=0) - 0.5, every.max(axis=0) + 0.5
    preview.write_preview(
        path, drawn, low=(float(low[0]), float(low[1])), high=(float(high[0]), float(high[1]))
    )
