"""Compare the clouds of two revisions: points added and removed, tile by tile, and a picture of them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from service.db.comparisons import Comparison
from service.db.revisions import find_artifact
from service.domain.comparison import CloudComparison, TileChange
from service.domain.errors import ArtifactNotFound
from service.usecases.compare import PICTURE, record_comparison
from worker.context import JobContext
from worker.formats import preview
from worker.formats.pcd import read_pcd
from worker.formats.reading import load_walls_and_columns
from worker.geometry.cloud.difference import CloudDifference, cloud_difference
from worker.geometry.cloud.point_cloud import PointCloud, joined
from worker.geometry.drawing.reading.reading import Wall

Corner = tuple[int, int]


@dataclass(frozen=True)
class _Side:
    """Hold one of two revisions: the tiles of its cloud by their corner, and its walls."""

    tiles: dict[Corner, Path]
    walls: tuple[Wall, ...]
    tile_size_m: int


def compare_revisions(context: JobContext) -> None:
    """Compare the tiles that differ, point by point, and record what came of it with the end of the job."""
    old, new = _sides(context)
    changed = sorted(c for c in old.tiles | new.tiles if old.tiles.get(c) != new.tiles.get(c))
    found: dict[Corner, CloudDifference] = {}
    for number, corner in enumerate(changed):
        context.progress("compare", 0.1 + 0.7 * number / len(changed))
        before, after = (_cloud(context, side.tiles.get(corner)) for side in (old, new))
        found[corner] = cloud_difference(before, after)
    context.progress("picture", 0.85)
    picture = context.folder("comparison") / PICTURE
    _picture(picture, old, new, list(found.values()))
    stored = context.kernel.blobs.adopt(picture)
    with context.kernel.db.writing("record-comparison") as session:
        record_comparison(
            context.kernel, session, context.attempt, geometry=_compared(old, new, found), picture=stored
        )


def _sides(context: JobContext) -> tuple[_Side, _Side]:
    with context.kernel.db.reading() as session:
        row = session.get_one(Comparison, context.attempt.subject_id)
        paths = []
        for revision_id in (row.from_revision_id, row.to_revision_id):
            files = [find_artifact(session, revision_id, path=p) for p in ("manifest.json", "walls.geojson")]
            if None in files:
                raise ArtifactNotFound("One of the revisions was built without tiles: rebuild it first.")
            paths.append([context.kernel.blobs.path(file.sha256) for file in files if file is not None])
    old, new = (_side(context, manifest, walls) for manifest, walls in paths)
    return old, new


def _side(context: JobContext, manifest: Path, walls: Path) -> _Side:
    told = json.loads(manifest.read_text(encoding="utf-8"))
    tiles = {
        (tile["corner_m"][0], tile["corner_m"][1]): context.kernel.blobs.path(tile["sha256"])
        for tile in told["tiles"]
    }
    return _Side(tiles, load_walls_and_columns(walls, bounds=context.bounds)[0], told["tile_size_m"])


def _cloud(context: JobContext, path: Path | None) -> PointCloud:
    return PointCloud.of(np.zeros((0, 3))) if path is None else read_pcd(path, context.bounds)


def _compared(old: _Side, new: _Side, found: dict[Corner, CloudDifference]) -> CloudComparison:
    tiles = tuple(
        TileChange(corner, _change(corner, old, new), len(one.added), len(one.removed), one.kept)
        for corner, one in found.items()
    )
    return CloudComparison(
        points_added=sum(one.points_added for one in tiles),
        points_removed=sum(one.points_removed for one in tiles),
        tile_size_m=new.tile_size_m,
        tiles_unchanged=sum(1 for corner in new.tiles if corner in old.tiles and corner not in found),
        tiles=tiles,
    )


def _change(corner: Corner, old: _Side, new: _Side) -> Literal["added", "removed", "changed"]:
    if corner not in old.tiles:
        return "added"
    return "changed" if corner in new.tiles else "removed"


def _picture(path: Path, old: _Side, new: _Side, found: list[CloudDifference]) -> None:
    """Draw both revisions' walls, and over them what went and what came."""
    went, came = (joined([getattr(one, name) for one in found]) for name in ("removed", "added"))
    faces = tuple(f for w in old.walls + new.walls for f in w.faces)
    every = np.vstack([*faces, went.points[:, :2], came.points[:, :2]])
    drawn = [
        preview.Drawn(preview.BODY, lines=faces, width=2),
        preview.Drawn(preview.GONE, points=went.points[:, :2], label=f"removed: {len(went)} points"),
        preview.Drawn(preview.LAYER, points=came.points[:, :2], label=f"added: {len(came)} points"),
    ]
    low, high = every.min(axis=0) - 0.5, every.max(axis=0) + 0.5
    preview.write_preview(
        path, drawn, low=(float(low[0]), float(low[1])), high=(float(high[0]), float(high[1]))
    )
