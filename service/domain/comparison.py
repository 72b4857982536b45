"""What the clouds of two revisions differ in: points and tiles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from service.domain.measured import Measured


@dataclass(frozen=True)
class TileChange(Measured):
    """Hold what became of one tile.

    Parameters
    ----------
    corner_m : tuple of 2 int
        Its lower left corner in frame `map` [m].
    change : {"added", "removed", "changed"}
        Whether one of the revisions has no such tile.
    points_added, points_removed, points_kept : int
        Points of the later revision that the earlier one lacks, the reverse, and those of both.
    """

    corner_m: tuple[int, int]
    change: Literal["added", "removed", "changed"]
    points_added: int
    points_removed: int
    points_kept: int


@dataclass(frozen=True)
class CloudComparison(Measured):
    """Hold the points and tiles that a later revision has more, or less, than an earlier one.

    Parameters
    ----------
    points_added, points_removed : int
        Of all tiles together.
    tile_size_m : int
        Edge of a tile [m].
    tiles_unchanged : int
        How many tiles have the same bytes.
    tiles : tuple of TileChange
        The others.
    """

    points_added: int
    points_removed: int
    tile_size_m: int
    tiles_unchanged: int
    tiles: tuple[TileChange, ...]
