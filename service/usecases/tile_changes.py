"""Tell which tiles of a map were added, changed or removed between two revisions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from service.db.session import Session
from service.domain.access import Actor
from service.usecases.download import artifact_file
from service.usecases.kernel import Kernel

MANIFEST_PATH = "manifest.json"

Tile = Mapping[str, Any]
"""A tile as the manifest tells of it: path, sha256, size_bytes, corner_m, points."""


@dataclass(frozen=True)
class TileChanges:
    """Hold what differs between the tiles of two revisions; a tile is the same square of the map in both.

    Parameters
    ----------
    tile_size_m : int
        Edge of a square.
    added : sequence of Tile
        Squares that only the new revision has points in.
    changed : sequence of tuple of Tile
        The square before and after.
    removed : sequence of Tile
        Squares that only the old revision has points in.
    unchanged : int
        How many squares are the same, byte for byte.
    """

    tile_size_m: int
    added: Sequence[Tile]
    changed: Sequence[tuple[Tile, Tile]]
    removed: Sequence[Tile]
    unchanged: int


def tile_changes(
    kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int, since: int
) -> TileChanges:
    """Return what became of the tiles between revision `since` and revision `n`, in the manifest's order.

    Raises
    ------
    MapNotFound, RevisionNotFound, RevisionNotReady
        As `ready_revision`, for either revision.
    ArtifactNotFound
        If one of them was built without tiles.
    """
    old, new = (_manifest(kernel, session, actor, map_id=map_id, n=k) for k in (since, n))
    before, after = _by_corner(old), _by_corner(new)
    both = [corner for corner in after if corner in before]
    changed = [(before[c], after[c]) for c in both if before[c]["sha256"] != after[c]["sha256"]]
    return TileChanges(
        tile_size_m=new["tile_size_m"],
        added=[tile for corner, tile in after.items() if corner not in before],
        changed=changed,
        removed=[tile for corner, tile in before.items() if corner not in after],
        unchanged=len(both) - len(changed),
    )


def _manifest(kernel: Kernel, session: Session, actor: Actor, *, map_id: str, n: int) -> dict[str, Any]:
    file = artifact_file(kernel, session, actor, map_id=map_id, n=n, path=MANIFEST_PATH)
    manifest: dict[str, Any] = json.loads(file.path.read_text(encoding="utf-8"))
    return manifest


def _by_corner(manifest: dict[str, Any]) -> dict[tuple[int, int], Tile]:
    return {(tile["corner_m"][0], tile["corner_m"][1]): tile for tile in manifest["tiles"]}
