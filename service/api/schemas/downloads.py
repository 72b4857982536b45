"""Tiles, their changes, and signed links as JSON."""

from __future__ import annotations

from datetime import datetime
from typing import Self

from pydantic import Field

from service.api.schemas.base import Output
from service.usecases.tile_changes import Tile, TileChanges


class TileOut(Output):
    """A square of the map's cloud as a file of its own."""

    path: str = Field(description="Among the revision's artifacts: `tiles/<sha256>.pcd`.")
    sha256: str
    size_bytes: int
    corner_m: list[int] = Field(description="Smallest x and y of the square in frame `map`, whole metres.")
    points: int
    url: str

    @classmethod
    def of(cls, tile: Tile, *, map_id: str, n: int, base_url: str) -> Self:
        """Return a tile of revision `n` as JSON."""
        return cls(**tile, url=f"{base_url}/v1/maps/{map_id}/revisions/{n}/artifacts/{tile['path']}")


class ChangedTileOut(Output):
    """A square that both revisions have points in, not the same ones."""

    before: TileOut
    after: TileOut


class ChangesOut(Output):
    """What became of the tiles between two revisions."""

    map_id: str
    since: int
    revision: int
    tile_size_m: int
    added: list[TileOut]
    changed: list[ChangedTileOut]
    removed: list[TileOut]
    unchanged: int = Field(description="How many squares are the same, byte for byte.")

    @classmethod
    def of(cls, found: TileChanges, *, map_id: str, n: int, since: int, base_url: str) -> Self:
        """Return the changes as JSON."""

        def shown(tile: Tile, k: int) -> TileOut:
            return TileOut.of(tile, map_id=map_id, n=k, base_url=base_url)

        return cls(
            map_id=map_id,
            since=since,
            revision=n,
            tile_size_m=found.tile_size_m,
            added=[shown(tile, n) for tile in found.added],
            changed=[ChangedTileOut(before=shown(a, since), after=shown(b, n)) for a, b in found.changed],
            removed=[shown(tile, since) for tile in found.removed],
            unchanged=found.unchanged,
        )


class LinkOut(Output):
    """A link that works without a key until it expires."""

    url: str
    sha256: str
    size_bytes: int
    expires_at: datetime
