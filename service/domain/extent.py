"""How far something reaches."""

from __future__ import annotations

from dataclasses import dataclass

from service.domain.measured import Measured


@dataclass(frozen=True)
class Extent(Measured):
    """Hold the smallest and the largest of each coordinate [m]."""

    min: tuple[float, float, float]
    max: tuple[float, float, float]
