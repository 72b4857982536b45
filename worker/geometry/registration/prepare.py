"""A tablet scan made ready to be placed: thinned, with normals, its floor and its upright structure found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import CoordinatesTooLarge, PlacementNotComputed
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.registration.cell_moments import cell_moments
from worker.geometry.registration.structure import Structure, find_floor, find_structure, find_viewpoint
from worker.geometry.registration.surfaces import estimate_normals

_NDT_STEP = 0.2
_FIT_STEP = 0.1
_MOST_COARSE = 8_000
_MOST_FINE = 8_000
_LEAST_POINTS = 100
_FARTHEST = 50_000.0


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """Hold what a placement needs of a scan, in frame `scan` [m].

    Parameters
    ----------
    coarse : ndarray of shape (C, 3), float64
        Thinned to 20 cm, for NDT.
    fine, normals : ndarrays of shape (N, 3), float64
        Thinned to 10 cm, at most 8,000 points, with normals towards the tablet; zero where it is not flat.
    structure : Structure
        The upright pieces above furniture, seen from above.
    floor : float or None
        Height of the floor.
    viewpoint : ndarray of shape (3,), float64
        Where the tablet was.
    radius : float
        Distance of the farthest point from the scan's middle.
    """

    coarse: NDArray[np.float64]
    fine: NDArray[np.float64]
    normals: NDArray[np.float64]
    structure: Structure
    floor: float | None
    viewpoint: NDArray[np.float64]
    radius: float

    @property
    def middle(self) -> NDArray[np.float64]:
        """Return the scan's middle (3,): poses are compared by where they put it [m]."""
        return np.asarray(self.coarse.mean(axis=0), dtype=np.float64)


def prepare_scan(scan: PointCloud) -> PreparedScan:
    """Return the scan made ready.

    Raises
    ------
    CoordinatesTooLarge
        If it reaches farther than 50 km from its origin.
    PlacementNotComputed
        If it has too few points.
    """
    if len(scan) and not np.abs(scan.points).max() < _FARTHEST:
        raise CoordinatesTooLarge(
            f"The scan reaches {np.abs(scan.points).max():.0f} m from its origin, and a tablet's scan lies "
            "around it; subtract the offset from its coordinates."
        )
    fine = cell_moments(scan.points, _FIT_STEP).means
    if len(fine) < _LEAST_POINTS:
        raise PlacementNotComputed(
            f"The scan has {len(fine)} points at {_FIT_STEP} m spacing; "
            f"at least {_LEAST_POINTS} are needed to place it."
        )
    coarse = _thinned(fine, _NDT_STEP, most=_MOST_COARSE)
    viewpoint = find_viewpoint(fine)
    normals, flat = estimate_normals(fine, towards=viewpoint)
    normals[~flat] = 0.0
    floor = find_floor(fine, normals, viewpoint=viewpoint)
    structure = find_structure(fine, normals, floor=floor, viewpoint=viewpoint)
    some = slice(None, None, 1 + (len(fine) - 1) // _MOST_FINE)
    return PreparedScan(
        coarse,
        np.ascontiguousarray(fine[some]),
        np.ascontiguousarray(normals[some]),
        structure,
        floor,
        viewpoint,
        float(np.linalg.norm(fine - coarse.mean(axis=0), axis=1).max()),
    )


def _thinned(points: NDArray[np.float64], step: float, *, most: int) -> NDArray[np.float64]:
    """Return one point a voxel of edge `step` [m], and a wider one where that gives more than `most`."""
    kept = cell_moments(points, step).means
    if len(kept) > most:
        kept = cell_moments(points, step * float(np.sqrt(len(kept) / most))).means
    return kept
