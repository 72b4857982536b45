"""Which faces of walls a sensor can see: those that another wall or column stands against are hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from worker.geometry.drawing.reading.reading import Column, Wall

_PROBES = (0.02, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3)


@dataclass(frozen=True, eq=False)
class Solids:
    """Hold the ground that walls and columns stand on, seen from above, as one shapely geometry [m]."""

    ground: Any

    @classmethod
    def of(cls, walls: Sequence[Wall], columns: Sequence[Column]) -> Solids:
        """Return the union of all footprints."""
        outlines = [np.vstack([wall.faces[0], wall.faces[1][::-1]]) for wall in walls]
        outlines += [column.outline for column in columns]
        ground = shapely.union_all([shapely.make_valid(shapely.Polygon(o)) for o in outlines if len(o) >= 3])
        shapely.prepare(ground)
        return cls(ground)

    def hides(self, foot: NDArray[np.float64], outward: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which places on faces have something solid within 0.3 m in front of them.

        An outer wall drawn with three lines reads as two walls back to back: the faces at the middle line
        lie inside the wall, and so do those across a gap that nobody can stand in. A scan placed on one of
        them is a wall's layer off.

        Parameters
        ----------
        foot, outward : ndarray of shape (N, 2), float64
            Places on faces, and the unit directions in which the faces look [m].
        """
        hidden = np.zeros(len(foot), dtype=bool)
        for reach in _PROBES:
            probe = foot + reach * outward
            hidden |= shapely.contains_xy(self.ground, probe[:, 0], probe[:, 1])
        return hidden
