"""A scan and the map it is placed on: the prepared scan, the map, and what of the map lies around a pose."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import PlacementNotComputed
from service.domain.transform import Transform
from worker.geometry.registration.ndt_map import NdtMap, build_ndt_map
from worker.geometry.registration.prepare import PreparedScan
from worker.geometry.registration.surfaces import Surfaces
from worker.geometry.registration.target import PlacementTarget

MARGIN = 2.0
"""How far around a scan the map is looked at, and the lattice on which that is kept [m]."""
_FURNITURE = 1.2
_STRIDE = 1.0


@dataclass(frozen=True, eq=False)
class Pairing:
    """Hold scan and map, and what of the map lies around the poses looked at."""

    scan: PreparedScan
    target: PlacementTarget
    ndt_resolution: float
    _around: dict[tuple[float, ...], Surfaces] = field(default_factory=dict)

    @property
    def structure_from(self) -> float | None:
        """Return the height above which upright things are walls [m], where the floor is known."""
        return _FURNITURE if self.target.kind == "faces" else None

    def centre(self, pose: Transform) -> NDArray[np.float64]:
        """Return the scan's middle at a pose, on a lattice of 2 m so that near poses share what is there."""
        middle = pose.apply(self.scan.middle[None])[0]
        return np.asarray(np.round(middle / MARGIN) * MARGIN, dtype=np.float64)

    def surfaces(self, pose: Transform) -> Surfaces:
        """Return the map's surfaces around a pose; of a cloud those that the tablet could see.

        Raises
        ------
        PlacementNotComputed
            If there is none.
        """
        centre = self.centre(pose)
        eye = np.round(pose.apply(self.scan.viewpoint[None])[0] / _STRIDE) * _STRIDE
        key = (*centre[:2], *(eye if self.target.kind == "cloud" else ()))
        if key not in self._around:
            top, radius = float(np.ptp(self.scan.fine[:, 2])), self.scan.radius + MARGIN
            self._around[key] = self.target.around(centre, radius, eye=eye, top=top)
        if not len(self._around[key]):
            raise PlacementNotComputed(
                f"The map has no surface within {self.scan.radius + MARGIN:.1f} m of the rough pose "
                f"(x {centre[0]:.1f}, y {centre[1]:.1f}); check the rough pose."
            )
        return self._around[key]

    def ndt_map(self, pose: Transform, grid: float) -> NdtMap:
        """Return the NDT map around a pose.

        Raises
        ------
        PlacementNotComputed
            If it has no cell.
        """
        centre, radius = self.centre(pose), self.scan.radius + 2.0 * MARGIN
        faces = self.target.kind == "faces"
        built = build_ndt_map(self.surfaces(pose).points if faces else self.target.near(centre, radius), grid)
        if not len(built):
            raise PlacementNotComputed(
                f"The map has no surface within {radius:.1f} m of the rough pose (x {centre[0]:.1f}, "
                f"y {centre[1]:.1f}) that fills a cell of {grid:g} m; check the rough pose, or the size of "
                "the NDT cells."
            )
        return built
