"""Placing a tablet scan on a map from a rough pose (paper, section 2.3, steps 3 and 4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from service.domain.errors import PlacementNotComputed
from service.domain.evidence import PlacementEvidence
from service.domain.transform import Transform
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.cloud.voxel_grid import voxel_grid_filter
from worker.geometry.registration import measure
from worker.geometry.registration.fitness import (
    euclidean_fitness_score,
    nearest_voxel_transformation_likelihood,
    transformation_probability,
)
from worker.geometry.registration.ndt import ALL_SIX, LEVELLED, register_ndt
from worker.geometry.registration.ndt_map import NdtMap, build_ndt_map
from worker.geometry.registration.refine import refine_to_surfaces
from worker.geometry.registration.starts import End, apart_at, ends_of, merge_ends, start_poses
from worker.geometry.registration.surfaces import Surfaces, estimate_normals
from worker.geometry.registration.target import PlacementTarget

Progress = Callable[[str, float], None]

TARGET, REFERENCE = 0, 1
"""Labels of a scan's points: not explained by the map, and explained by it."""
_NDT_STEP = 0.2
_FIT_STEP = 0.1
_MOST_COARSE = 8_000
_MOST_FINE = 8_000
_MARGIN = 2.0
_MOST_CANDIDATES = 4
_FURNITURE = 1.2
_BATCH = 200_000


@dataclass(frozen=True, eq=False)
class Candidate:
    """Hold a pose that starts ended at, and the share of the scan's structure that it explains."""

    T_map_scan: Transform
    inlier_share_of_structure: float
    inlier_share: float
    starts: int

    def to_json(self) -> dict[str, Any]:
        """Return the candidate as a JSON object."""
        return {
            "T_map_scan": self.T_map_scan.tolist(),
            "inlier_share_of_structure": self.inlier_share_of_structure,
            "inlier_share": self.inlier_share,
            "starts": self.starts,
        }


@dataclass(frozen=True, eq=False)
class Placed:
    """Hold the outcome of a placement; whether to believe it is for `service.domain.acceptance` to say.

    Parameters
    ----------
    T_map_scan : Transform
        The pose.
    evidence : PlacementEvidence
        What was measured there.
    labels : ndarray of shape (N,), uint8
        `REFERENCE` or `TARGET` for each point of the scan as it was given.
    candidates : tuple of Candidate
        The poses found, the one given first.
    """

    T_map_scan: Transform
    evidence: PlacementEvidence
    labels: NDArray[np.uint8]
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, eq=False)
class _Problem:
    """Hold scan and map, prepared: thinned points, normals towards the tablet, surfaces, NDT maps."""

    coarse: NDArray[np.float64]
    fine: NDArray[np.float64]
    normals: NDArray[np.float64]
    surfaces: Surfaces
    maps: tuple[NdtMap, ...]
    target: PlacementTarget
    cloud: NDArray[np.float64]

    @property
    def structure_from(self) -> float | None:
        """Return the height above which upright things are walls [m], where the floor is known."""
        return _FURNITURE if self.target.kind == "faces" else None


@dataclass(frozen=True, eq=False)
class _Found:
    """Hold a refined end with its fit."""

    end: End
    fit: measure.Fit


def place_scan(
    scan: PointCloud,
    target: PlacementTarget,
    *,
    initial: Transform,
    ndt_resolution: float = 1.0,
    progress: Progress | None = None,
) -> Placed:
    """Return where a scan lies on a map, found from a rough pose, with the evidence for it.

    The pose is the best that was found, never a fallback to `initial`; it may be wrong.

    Parameters
    ----------
    scan : PointCloud
        N points, metres, z up, in frame `scan`; its origin is where the tablet was.
    target : PlacementTarget
        The map.
    initial : Transform
        Rough `T_map_scan`: within about 0.7 m and 10 degrees.
    ndt_resolution : float
        Edge of the NDT cells [m]; twice and half of it are used before and after it.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Placed
        Pose, evidence, labels, candidates.

    Raises
    ------
    PlacementNotComputed
        If nothing of the map is near the rough pose, or the scan has too few points.

    Notes
    -----
    NDT at falling cell sizes (Magnusson 2009) from the rough pose and six around it; each distinct end is
    refined to the map's surfaces, robustly; the one that explains most of the scan's structure is given.
    The same inputs give the same bytes, whatever the number of threads.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("prepare", 0.0)
    problem = _prepare(scan, target, initial, ndt_resolution)
    middle = problem.coarse.mean(axis=0)
    starts = start_poses(initial, initial.apply(middle[None])[0])
    ends = ends_of(
        problem.coarse, problem.maps[:2], starts=starts, told=lambda share: tell("ndt", 0.1 + 0.5 * share)
    )
    tell("refine", 0.6)
    found = _refine_ends(problem, ends, middle)
    best = found[0]
    tell("measure", 0.8)
    evidence = _evidence(problem, found, initial=initial, starts=len(starts), middle=middle)
    labels = _labels(scan, problem.surfaces, best.end.T_map_scan)
    candidates = tuple(
        Candidate(f.end.T_map_scan, f.fit.structure_share, f.fit.inlier_share, f.end.starts) for f in found
    )
    tell("done", 1.0)
    return Placed(best.end.T_map_scan, evidence, labels, candidates)


def _prepare(
    scan: PointCloud, target: PlacementTarget, initial: Transform, ndt_resolution: float
) -> _Problem:
    """Return the thinned scan and what of the map lies around it."""
    coarse = _thinned(scan.points, _NDT_STEP, most=_MOST_COARSE)
    fine = voxel_grid_filter(scan.points, _FIT_STEP)
    if len(fine) < 100:
        raise PlacementNotComputed(
            f"The scan has {len(fine)} points at {_FIT_STEP} m spacing; at least 100 are needed to place it."
        )
    normals, flat = estimate_normals(fine, towards=np.zeros(3))
    normals[~flat] = 0.0
    some = slice(None, None, 1 + (len(fine) - 1) // _MOST_FINE)
    fine, normals = np.ascontiguousarray(fine[some]), np.ascontiguousarray(normals[some])
    centre = initial.apply(scan.points.mean(axis=0)[None])[0]
    radius = float(np.linalg.norm(scan.points - scan.points.mean(axis=0), axis=1).max()) + _MARGIN
    surfaces = target.around(centre, radius)
    cloud = target.near(centre, radius) if target.kind == "cloud" else surfaces.points
    grids = (2.0 * ndt_resolution, ndt_resolution, 0.5 * ndt_resolution)
    maps = tuple(build_ndt_map(cloud, grid) for grid in grids)
    if len(maps[1]) == 0 or len(maps[0]) == 0:
        raise PlacementNotComputed(
            f"The map has no surface within {radius:.1f} m of the rough pose "
            f"(x {centre[0]:.1f}, y {centre[1]:.1f}); check the rough pose, or the size of the NDT cells."
        )
    return _Problem(coarse, fine, normals, surfaces, maps, target, cloud)


def _thinned(points: NDArray[np.float64], step: float, *, most: int) -> NDArray[np.float64]:
    """Return one point a voxel of edge `step` [m], and a wider one where that gives more than `most`."""
    kept = voxel_grid_filter(points, step)
    if len(kept) > most:
        kept = voxel_grid_filter(points, step * float(np.sqrt(len(kept) / most)))
    return kept


def _refine_ends(problem: _Problem, ends: list[End], middle: NDArray[np.float64]) -> list[_Found]:
    """Return the ends refined, made distinct again, the one that explains most first."""
    refined = []
    for end in ends[:_MOST_CANDIDATES]:
        pose, iterations, converged = end.T_map_scan, end.iterations, end.converged
        if problem.target.kind == "cloud" and len(problem.maps[2]):
            result = register_ndt(problem.coarse, problem.maps[2], initial=pose, tolerance=1e-3)
            pose, iterations = result.T_target_source, iterations + result.iterations
            converged = result.converged
        else:
            last = refine_to_surfaces(problem.fine, problem.normals, problem.surfaces, initial=pose)
            pose, iterations, converged = last.T_map_scan, iterations + last.iterations, last.converged
        fit = _fit(problem, pose)
        score = fit.structure_share + 0.1 * fit.inlier_share
        refined.append(End(pose, score, end.starts, converged, iterations))
    return [_Found(end, _fit(problem, end.T_map_scan)) for end in merge_ends(refined, middle)]


def _fit(problem: _Problem, pose: Transform) -> measure.Fit:
    return measure.measure_fit(
        problem.fine, problem.normals, problem.surfaces, pose=pose, structure_from=problem.structure_from
    )


def _evidence(
    problem: _Problem, found: list[_Found], *, initial: Transform, starts: int, middle: NDArray[np.float64]
) -> PlacementEvidence:
    """Return everything measured at the best pose, and what else was found."""
    best, pose = found[0], found[0].end.T_map_scan
    faces = problem.target.kind == "faces"
    off = np.abs(best.fit.distance[best.fit.inlier])
    shift, turn = measure.map_error_effect(best.fit, pose=pose, unknowns=LEVELLED)
    eigenvalues, weak = measure.information(best.fit, unknowns=LEVELLED if faces else ALL_SIX)
    tree = problem.surfaces.tree if faces else KDTree(problem.cloud)
    placed = pose.apply(problem.coarse)
    near = tree.query(placed, distance_upper_bound=problem.maps[1].resolution)[0]
    others = [(*apart_at(pose, f.end.T_map_scan, middle), f.fit.structure_share) for f in found[1:]]
    runner_up = max(others, key=lambda other: other[2], default=(None, None, None))
    moved_by, turned_by = apart_at(pose, initial, middle)
    return PlacementEvidence(
        map_kind=problem.target.kind,
        converged=best.end.converged,
        iterations=sum(f.end.iterations for f in found),
        points_compared=len(problem.fine),
        inlier_distance_m=measure.INLIER_DISTANCE,
        inlier_share=best.fit.inlier_share,
        inlier_share_of_structure=best.fit.structure_share,
        residual_rms_m=float(np.sqrt(np.mean(off**2))) if len(off) else measure.INLIER_DISTANCE,
        residual_median_m=float(np.median(off)) if len(off) else measure.INLIER_DISTANCE,
        overlap_share=float(np.mean(np.isfinite(near))),
        euclidean_fitness_score_m2=euclidean_fitness_score(placed, tree),
        transformation_probability=transformation_probability(placed, problem.maps[1]),
        nearest_voxel_transformation_likelihood=nearest_voxel_transformation_likelihood(
            placed, problem.maps[1]
        ),
        ndt_resolution_m=problem.maps[1].resolution,
        information_eigenvalues=eigenvalues,
        weak_directions=weak,
        position_sensitivity_m=shift,
        yaw_sensitivity_rad=turn,
        contradicted_share=_contradicted(problem, best.fit, pose),
        upright_surfaces=measure.upright_surfaces(best.fit, sided=faces),
        starts=starts,
        starts_agreeing=best.end.starts,
        runner_up_distance_m=runner_up[0],
        runner_up_turn_rad=runner_up[1],
        runner_up_inlier_share=runner_up[2],
        moved_m=moved_by,
        turned_rad=turned_by,
        tilt_rad=float(np.arccos(np.clip(pose.rotation[2, 2], -1.0, 1.0))),
    )


def _contradicted(problem: _Problem, fit: measure.Fit, pose: Transform) -> float:
    """Return the share of the structure that the tablet would have had to see through a wall."""
    structure = fit.placed[fit.structure & (fit.placed[:, 2] < problem.target.wall_height)]
    if not len(structure):
        return 0.0
    return float(np.mean(problem.target.seen_through(structure, viewpoint=pose.translation)))


def _labels(scan: PointCloud, surfaces: Surfaces, pose: Transform) -> NDArray[np.uint8]:
    """Return for every point of the scan whether the map explains it."""
    labels = np.zeros(len(scan), dtype=np.uint8)
    for begin in range(0, len(scan), _BATCH):
        piece = slice(begin, begin + _BATCH)
        distance, _, found = surfaces.match(pose.apply(scan.points[piece]), None, reach=measure.REACH)
        labels[piece] = np.where(found & (np.abs(distance) < measure.INLIER_DISTANCE), REFERENCE, TARGET)
    return labels
