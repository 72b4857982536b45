"""What the service tells the dashboard beside its API's description; run as a module, it refreshes the file.

The dashboard's types of evidence, readings and files are written by hand: `service/web/app/src/api/told.ts`.
The file made here holds what the service itself writes, as TypeScript that has to be of those types.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from service.domain.findings import Finding
from worker.formats.octree import write_octree
from worker.formats.reading import write_reading, write_walls
from worker.formats.sheet_tiles import write_sheet_tiles
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall
from worker.geometry.drawing.scale.decision import Scale, Witness, given

TOLD = Path(__file__).resolve().parents[2] / "service/web/app/tests/told.ts"
HEAD = """/** What the service tells; `poe told` writes it anew. */
import type { Told } from "./types";

export const told: Told = """

_WALL = Wall.of(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]), thickness=0.2)
_PIER = Column(np.array([[1.0, 1.0], [1.4, 1.0], [1.4, 1.4], [1.0, 1.4]]))
_TEXT = RemovedStroke((np.array([[1.0, 1.0], [2.0, 2.0]]),), "text", "small")


def told() -> dict[str, Any]:
    """Return everything by the name of its type, several of each where they take several forms."""
    with tempfile.TemporaryDirectory() as folder:
        return _files(Path(folder))


def shape_of(value: Any) -> Any:
    """Return a JSON value with the kind of each scalar in its place, a list as the kinds that it holds."""
    if isinstance(value, dict):
        return {name: shape_of(member) for name, member in value.items()}
    if isinstance(value, list):
        return sorted({json.dumps(shape_of(one), sort_keys=True) for one in value})
    return (
        "number" if isinstance(value, (int, float)) and not isinstance(value, bool) else type(value).__name__
    )


def written() -> Any:
    """Return what the file holds."""
    return json.loads(TOLD.read_text(encoding="utf-8").removeprefix(HEAD).rstrip().removesuffix(";"))


def _files(folder: Path) -> dict[str, Any]:
    strokes = []
    for number, reading in enumerate(_readings()):
        directory = folder / str(number)
        directory.mkdir()
        walls, removed, _, _ = write_reading(reading, directory)
        strokes += [json.loads(path.read_text(encoding="utf-8")) for path in (walls, removed)]
    write_walls(folder / "walls.geojson", [_WALL], [_PIER], frame="map")
    cloud = PointCloud.of(np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.5], [3.0, 1.0, 1.0]]))
    write_octree(folder, cloud)
    sheet, _ = write_sheet_tiles(folder, np.zeros((300, 400), dtype=np.uint8))
    return {
        "strokes": strokes,
        "walls": [json.loads((folder / "walls.geojson").read_text(encoding="utf-8"))],
        "octrees": [json.loads((folder / "octree.json").read_text(encoding="utf-8"))],
        "sheets": [json.loads(sheet.read_text(encoding="utf-8"))],
    }


def _readings() -> list[Reading]:
    """Return a reading in metres and one whose witnesses disagree, y up and y down."""
    witnesses = (Witness("title-block", 0.01, 0.01, "1:100", 1), Witness("wall", 0.02, 0.05, "usual", 9))
    unknown = Scale("unknown", None, witnesses, (0.01, 0.03))
    return [
        Reading((_WALL,), (_PIER,), (_TEXT,), (5.0, 4.0), given(0.01), "outlined"),
        Reading(
            (_WALL,), (_PIER,), (_TEXT,), (500.0, 400.0), unknown, "outlined", top=400.0,
            findings=(Finding("scale-unknown", "warning", "No two witnesses agree."),),
        ),
    ]  # fmt: skip


def text() -> str:
    """Return the whole file."""
    return f"{HEAD}{json.dumps(told(), indent=1, sort_keys=True, ensure_ascii=False)};\n"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    TOLD.write_text(text(), encoding="utf-8")
