"""How a scan lies on the map at a pose, and the evidence that a placement gives for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from service.domain.evidence import PlacementEvidence
from service.domain.transform import Transform
from worker.geometry.registration import measure
from worker.geometry.registration.fitness import (
    euclidean_fitness_score,
    nearest_voxel_transformation_likelihood,
    transformation_probability,
)
from worker.geometry.registration.lone_wall import Slide, rather_elsewhere
from worker.geometry.registration.ndt import ALL_SIX, LEVELLED
from worker.geometry.registration.pairing import MARGIN, Pairing
from worker.geometry.registration.pose_covariance import TILT, pose_covariance
from worker.geometry.registration.starts import End, apart_at
from worker.geometry.registration.undrawn import explained_share_at_top, undrawn_wall_share

_SEEN_THROUGH, _GIVE = 2.0, 0.15


@dataclass(frozen=True, eq=False)
class Found:
    """Hold a refined end with its fit, and the share of all points seen through walls there."""

    end: End
    fit: measure.Fit
    contradicted: float

    @property
    def score(self) -> float:
        """Return what candidates are ordered by."""
        return self.fit.structure_share + 0.1 * self.fit.inlier_share - _SEEN_THROUGH * self.contradicted


def look_at(pairing: Pairing, end: End) -> Found:
    """Return how the scan lies on the map at an end."""
    fit = _fit(pairing, end.T_map_scan)
    return Found(end, fit, _contradicted(pairing, fit, end.T_map_scan))


def _fit(pairing: Pairing, pose: Transform) -> measure.Fit:
    return measure.measure_fit(
        pairing.scan.fine,
        pairing.scan.normals,
        pairing.surfaces(pose),
        pose=pose,
        structure_from=pairing.structure_from,
    )


def gather_evidence(
    pairing: Pairing, found: list[Found], *, mirrored: Found | None, initial: Transform | None,
    starts: int, tried: int,
) -> PlacementEvidence:  # fmt: skip
    """Return everything measured at the best pose, and what else was found, of the mirror image too."""
    best, pose, middle = found[0], found[0].end.T_map_scan, pairing.scan.middle
    faces = pairing.target.kind == "faces"
    median, rms = _residuals(best.fit)
    shift, turn = measure.map_error_effect(best.fit, pose=pose, unknowns=LEVELLED)
    eigenvalues, weak = measure.information(best.fit, unknowns=LEVELLED if faces else ALL_SIX)
    stated = pose_covariance(best.fit, origin=pose.translation, sided=faces, held=TILT)
    ndt_map = pairing.ndt_map(pose, pairing.ndt_resolution)
    placed = pose.apply(pairing.scan.coarse)
    away = _away(pairing, pose, placed)
    runner_up = max(found[1:], key=lambda f: f.score, default=None)
    beside = (None, None) if runner_up is None else apart_at(pose, runner_up.end.T_map_scan, middle)
    rival, image = _explained(runner_up), _explained(mirrored)
    slide, moved = _slide(pairing, best.fit, pose), _moved(pose, initial, middle)
    return PlacementEvidence(
        map_kind=pairing.target.kind,
        converged=best.end.converged,
        iterations=sum(f.end.iterations for f in found),
        points_compared=len(pairing.scan.fine),
        inlier_distance_m=measure.INLIER_DISTANCE,
        inlier_share=best.fit.inlier_share,
        inlier_share_of_structure=best.fit.structure_share,
        residual_rms_m=rms,
        residual_median_m=median,
        overlap_share=float(np.mean(away < ndt_map.resolution)),
        euclidean_fitness_score_m2=euclidean_fitness_score(away),
        transformation_probability=transformation_probability(placed, ndt_map),
        nearest_voxel_transformation_likelihood=nearest_voxel_transformation_likelihood(placed, ndt_map),
        ndt_resolution_m=ndt_map.resolution,
        information_eigenvalues=eigenvalues,
        weak_directions=weak,
        position_sensitivity_m=shift,
        yaw_sensitivity_rad=turn,
        covariance=tuple(tuple(float(x) for x in row) for row in stated.matrix),
        position_std_m=stated.position_std,
        yaw_std_rad=stated.yaw_std,
        contradicted_share=best.contradicted,
        astray_share=_astray(pairing, best.fit, pose),
        upright_surfaces=len(measure.upright_planes(best.fit, best.fit.structure, sided=faces)),
        closed_directions=_closed(best.fit) if faces else 0,
        undrawn_wall_share=undrawn_wall_share(best.fit, _turned(pairing, pose)) if faces else 0.0,
        explained_share_at_top=explained_share_at_top(best.fit) if faces else 1.0,
        slide_gain=slide[0],
        slide_m=slide[1],
        poses_compared=tried,
        starts=starts,
        starts_agreeing=best.end.starts,
        runner_up_distance_m=beside[0],
        runner_up_turn_rad=beside[1],
        runner_up_inlier_share=rival[0],
        runner_up_contradicted_share=rival[1],
        mirrored_inlier_share=image[0],
        mirrored_contradicted_share=image[1],
        moved_m=moved[0],
        turned_rad=moved[1],
        tilt_rad=float(np.arccos(np.clip(pose.rotation[2, 2], -1.0, 1.0))),
    )


def _residuals(fit: measure.Fit) -> tuple[float, float]:
    """Return the median and the root mean square of the inliers' distances; their limit without any."""
    off = np.abs(fit.distance[fit.inlier])
    if not len(off):
        return measure.INLIER_DISTANCE, measure.INLIER_DISTANCE
    return float(np.median(off)), float(np.sqrt(np.mean(off**2)))


def _away(pairing: Pairing, pose: Transform, placed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far each placed point is from the nearest point of the map around."""
    if pairing.target.kind == "faces":
        tree = pairing.surfaces(pose).tree
    else:
        tree = KDTree(pairing.target.near(pairing.centre(pose), pairing.scan.radius + 2.0 * MARGIN))
    return np.asarray(tree.query(placed)[0], dtype=np.float64)


def _turned(pairing: Pairing, pose: Transform) -> NDArray[np.float64]:
    """Return the scan's own normals in frame `map`."""
    return pairing.scan.normals @ pose.rotation.T


def _moved(pose: Transform, initial: Transform | None, middle: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far a pose is from a rough one, at the scan's origin or its middle, and the turn [rad].

    0 where there was none.
    """
    if initial is None:
        return 0.0, 0.0
    at_middle, turn = apart_at(pose, initial, middle)
    return min(at_middle, apart_at(pose, initial, np.zeros(3))[0]), turn


def _contradicted(pairing: Pairing, fit: measure.Fit, pose: Transform) -> float:
    """Return the share of the points that the tablet would have had to see through a wall.

    Not just past its edge: a door's jamb may stand 15 cm from where it is drawn.
    """
    viewpoint = pose.apply(pairing.scan.viewpoint[None])[0]
    below = _below_the_walls_tops(pairing, fit)
    return (
        float(np.mean(pairing.target.seen_through(below, viewpoint=viewpoint, give=_GIVE)))
        if len(below)
        else 0.0
    )


def _closed(fit: measure.Fit) -> int:
    """Return in how many directions the tablet stood between two walls of the map that it saw."""
    planes = measure.upright_planes(fit, fit.upright, sided=True, least_share=measure.GLIMPSE)
    return measure.closed_directions(planes)


def _slide(pairing: Pairing, fit: measure.Fit, pose: Transform) -> Slide | tuple[None, None]:
    faces = pairing.target.faces
    slide = None if faces is None else rather_elsewhere(fit, _turned(pairing, pose), faces)
    return slide or (None, None)


def _explained(found: Found | None) -> tuple[float, float] | tuple[None, None]:
    """Return the share of the structure that another pose explains, and that seen through walls there."""
    return (None, None) if found is None else (found.fit.structure_share, found.contradicted)


def _below_the_walls_tops(pairing: Pairing, fit: measure.Fit) -> NDArray[np.float64]:
    return fit.placed[fit.placed[:, 2] < pairing.target.wall_height]


def _astray(pairing: Pairing, fit: measure.Fit, pose: Transform) -> float:
    """Return the share of the structure that is on no face and, unlike an object, in no room either."""
    faces, structure = pairing.target.faces, fit.structure
    if faces is None or not structure.any():
        return 0.0
    loose = fit.placed[structure & ~fit.inlier, :2]
    eye = pose.apply(pairing.scan.viewpoint[None])[0, :2]
    in_room = faces.backs(eye, loose) & ~faces.hidden_from(eye, loose)
    return float(np.count_nonzero(~in_room) / np.count_nonzero(structure))
