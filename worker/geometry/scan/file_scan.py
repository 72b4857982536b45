"""A scan as its file gives it: points or a mesh in the file's unit and axes, and what it says of these."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.scan.mesh_sampling import Mesh, sample_mesh

COARSE_POINTS = 120_000
"""Points on a mesh while its unit is not known."""

POINTS_PER_SQUARE_METRE = 2_500.0
"""Density of the points on a mesh: one for each square of 2 cm."""

MOST_POINTS_OF_A_MESH = 1_500_000
"""Those of 600 square metres: a larger mesh gets fewer a square metre, and costs no more to read."""

FEWEST_POINTS_OF_A_MESH = 1_000


@dataclass(frozen=True)
class Statement:
    """Hold what a file, or the definition of its format, says about its axes and unit.

    Parameters
    ----------
    up : str, optional
        The up axis, as in `service.domain.scan_options.UP_AXES`.
    metres_per_unit : float, optional
        What one unit counts [m].
    said_by : str
        A sentence for the evidence.
    """

    up: str | None = None
    metres_per_unit: float | None = None
    said_by: str = ""


@dataclass(frozen=True, eq=False)
class FileScan:
    """Hold a scan in its file's unit and axes.

    Parameters
    ----------
    surface : PointCloud or Mesh
        Its N >= 1 points, or its triangles.
    kind : str
        The format, for people: "PLY".
    statement : Statement
        What the file says of its axes and unit.
    """

    surface: PointCloud | Mesh
    kind: str
    statement: Statement = Statement()

    def coarse(self) -> NDArray[np.float64]:
        """Return (N, 3) points to find axes and unit by [the file's unit]."""
        if isinstance(self.surface, Mesh):
            return sample_mesh(self.surface, count=COARSE_POINTS)
        return self.surface.points

    def cloud(self, metres_per_unit: float) -> PointCloud:
        """Return the points in metres and the file's axes; a mesh gets a fixed number for each square metre.

        Parameters
        ----------
        metres_per_unit : float
            What one unit counts [m]; at 1 the coordinates of a cloud come back bit by bit.
        """
        if isinstance(self.surface, Mesh):
            wanted = float(self.surface.areas().sum()) * metres_per_unit**2 * POINTS_PER_SQUARE_METRE
            count = int(np.clip(wanted, FEWEST_POINTS_OF_A_MESH, MOST_POINTS_OF_A_MESH))
            return PointCloud.of(sample_mesh(self.surface, count=count) * metres_per_unit)
        if metres_per_unit == 1.0:
            return self.surface
        return PointCloud(self.surface.points * metres_per_unit, self.surface.labels)
