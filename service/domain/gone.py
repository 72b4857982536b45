"""What seems to have gone: things of a layer that a later scan looked through."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.domain.measured import Measured
from service.domain.region import Region


@dataclass(frozen=True)
class GoneThing(Measured):
    """Hold one thing that has gone: where it stood, and what a later scan tells of its points.

    Parameters
    ----------
    region : Region
        Around it, in frame `map`; None where an earlier version told of the layer as a whole.
    points : int
        How many of its points were asked about.
    still_seen : int
        Where the scan has a point within 15 cm.
    looked_through : int
        Where everything that the scan saw in their direction lies farther.
    """

    region: Region
    points: int
    still_seen: int
    looked_through: int


@dataclass(frozen=True)
class GoneLayer(Measured):
    """Hold what of a layer has gone: the evidence of a proposal to take it off.

    Parameters
    ----------
    layer_id, name : str
        The layer.
    whole_layer : bool
        Whether it is taken off whole: hardly anything of it is left.
    things : tuple of GoneThing
        What has gone, thing by thing.
    """

    layer_id: str
    name: str
    whole_layer: bool = True
    things: tuple[GoneThing, ...] = ()

    @classmethod
    def upgraded(cls, value: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return stored evidence with a layer that was looked at as a whole as one thing."""
        counts = {name: value[name] for name in ("points", "still_seen", "looked_through") if name in value}
        return {**value, "things": [counts]} if counts and "things" not in value else value
