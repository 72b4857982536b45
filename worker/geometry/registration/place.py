"""Placing a tablet scan on a map from a rough pose (paper, section 2.3, steps 3 and 4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import PlacementNotComputed
from service.domain.evidence import Candidate, PlacementEvidence
from service.domain.layer_part import REFERENCE, TARGET
from service.domain.transform import Transform
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.registration import measure
from worker.geometry.registration.cell_moments import cell_moments
from worker.geometry.registration.evidence import Found, gather_evidence, look_at
from worker.geometry.registration.mirror import best_mirrored
from worker.geometry.registration.pairing import Pairing
from worker.geometry.registration.prepare import prepare_scan
from worker.geometry.registration.refine import refine_to_surfaces
from worker.geometry.registration.search import Hypotheses, Region, search
from worker.geometry.registration.starts import End, ends_of, merge_ends, start_poses
from worker.geometry.registration.structure import level_shift
from worker.geometry.registration.surfaces import Surfaces, estimate_normals
from worker.geometry.registration.target import PlacementTarget

Progress = Callable[[str, float], None]

_MOST_CANDIDATES = 6
_WORTH, _HOPELESS, _RIVAL = 0.7, 0.5, 0.3
_NEAR, _NEAR_TURN = 0.25, np.deg2rad(3.0)
_ROUGH_RADIUS, _ROUGH_TURN = 3.2, np.deg2rad(48.0)
_HELD = 1.4
_LEAST_STRUCTURE = 12
_BATCH = 200_000
_LEVEL_STEP = 0.2


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


def place_scan(
    scan: PointCloud,
    target: PlacementTarget,
    *,
    initial: Transform | None,
    ndt_resolution: float = 1.0,
    progress: Progress | None = None,
) -> Placed:
    """Return where a scan lies on a map, found from a rough pose or from none, with the evidence for it.

    The pose is the best that was found, never a fallback to `initial`; it may be wrong.

    Parameters
    ----------
    scan : PointCloud
        N points, metres, z up, in frame `scan`; its origin is where the tablet was.
    target : PlacementTarget
        The map.
    initial : Transform or None
        Rough `T_map_scan`, within 3 m and 45 degrees; None searches the whole map.
    ndt_resolution : float
        Edge of the NDT cells [m]; on a cloud twice of it is used before.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Placed
        Pose, evidence, labels, candidates.

    Raises
    ------
    PlacementNotComputed
        If nothing of the map is near the rough pose, or the scan has too few points or no upright surface.

    Notes
    -----
    The scan's upright structure is searched for among the map's (`search`); each distinct place is refined to
    the map's surfaces, robustly; on a bare cloud NDT at falling cell sizes (Magnusson 2009) from seven starts
    around the rough pose finds places as well. The one that explains most of the scan's structure is given.
    The same inputs give the same bytes, whatever the number of threads.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("prepare", 0.0)
    pairing = Pairing(prepare_scan(scan), target, ndt_resolution)
    if initial is not None:
        pairing.surfaces(initial)
    tell("search", 0.2)
    hypotheses, ends = _hypotheses(pairing, initial)
    starts: tuple[Transform, ...] = ()
    if target.kind == "cloud" and initial is not None:
        starts = start_poses(initial, initial.apply(pairing.scan.middle[None])[0])
        maps = [pairing.ndt_map(initial, grid) for grid in (2.0 * ndt_resolution, ndt_resolution)]
        ends += ends_of(
            pairing.scan.coarse, maps, starts=starts, told=lambda share: tell("ndt", 0.3 + 0.3 * share)
        )[:_MOST_CANDIDATES]
    if not ends:
        raise PlacementNotComputed(
            "The scan shows no upright surface that could be a wall of the map; scan two walls or more, or "
            "give a rough pose."
        )
    tell("refine", 0.6)
    found = _refine_ends(pairing, ends, tell)
    best = found[0]
    tell("measure", 0.8)
    mirrored = None
    if hypotheses is not None and target.kind == "faces":
        least = float(hypotheses.score.max(initial=0.0))
        mirrored = best_mirrored(pairing, best.end.T_map_scan, region=_region(initial), least=least)
    evidence = gather_evidence(
        pairing,
        found,
        mirrored=mirrored,
        initial=initial,
        starts=len(starts),
        tried=hypotheses.tried if hypotheses is not None else 0,
    )
    labels = _labels(scan, pairing.surfaces(best.end.T_map_scan), best.end.T_map_scan)
    candidates = tuple(
        Candidate(f.end.T_map_scan, f.fit.structure_share, f.fit.inlier_share, f.end.starts) for f in found
    )
    tell("done", 1.0)
    return Placed(best.end.T_map_scan, evidence, labels, candidates)


def _hypotheses(pairing: Pairing, initial: Transform | None) -> tuple[Hypotheses | None, list[End]]:
    """Return what the search found, and the poses worth refining; the rough pose is one of them."""
    outline, region = pairing.target.outline, _region(initial)
    z = _height(pairing, initial)
    ends, hypotheses = [], None
    if len(pairing.scan.structure) >= _LEAST_STRUCTURE:
        hypotheses = search(pairing.scan.structure, outline, region=region)
        worth = hypotheses.score >= _WORTH * hypotheses.score.max(initial=0.0)
        for x, y, yaw in hypotheses.poses[worth][:_MOST_CANDIDATES]:
            ends.append(End(Transform.from_xyz_yaw(x, y, z, yaw), 0.0, 0, True, 0))
    if initial is not None and pairing.target.kind == "faces":
        x, y, _ = initial.translation
        ends.append(End(Transform.from_xyz_yaw(x, y, z, initial.rpy[2]), 0.0, 0, True, 0))
    return hypotheses, ends


def _region(initial: Transform | None) -> Region | None:
    """Return where the tablet may have been by a rough pose, if there is one."""
    if initial is None:
        return None
    x, y, _ = initial.translation
    return Region(float(x), float(y), float(initial.rpy[2]), _ROUGH_RADIUS, _ROUGH_TURN)


def _height(pairing: Pairing, initial: Transform | None) -> float:
    """Return the height of the scan's origin in frame `map`: by level surfaces, else by the rough pose."""
    scan, target = pairing.scan, pairing.target
    if target.kind == "cloud":
        if initial is not None:
            return float(initial.translation[2])
        points = cell_moments(target.points, _LEVEL_STEP).means
        return level_shift(scan.fine, scan.normals, onto=points, onto_normals=estimate_normals(points)[0])
    if scan.floor is not None:
        return -scan.floor
    if initial is not None:
        return float(initial.translation[2])
    return _HELD - float(scan.viewpoint[2])


def _refine_ends(pairing: Pairing, ends: list[End], tell: Progress) -> list[Found]:
    """Return the ends refined, made distinct again, the best first; those without hope are left out.

    Ends nearer than half the reach of the refinement come to the same pose: one of them is enough.
    """
    ends = merge_ends(ends, pairing.scan.middle, apart=_NEAR, turned=_NEAR_TURN)
    moved = []
    for done, end in enumerate(ends):
        tell("refine", 0.6 + 0.15 * done / len(ends))
        moved.append(_refine(pairing, end, thorough=False))
    distinct = merge_ends(moved, pairing.scan.middle)
    best = max(end.score for end in distinct)
    finished = [
        _refine(pairing, end, thorough=True) if end.score >= best - _RIVAL else end
        for end in distinct
        if end.score >= best - _HOPELESS
    ]
    found = [look_at(pairing, end) for end in merge_ends(finished, pairing.scan.middle)]
    return sorted(found, key=lambda f: -f.score)[:_MOST_CANDIDATES]


def _refine(pairing: Pairing, end: End, *, thorough: bool) -> End:
    last = refine_to_surfaces(
        pairing.scan.fine,
        pairing.scan.normals,
        pairing.surfaces(end.T_map_scan),
        initial=end.T_map_scan,
        thorough=thorough,
    )
    refined = End(last.T_map_scan, 0.0, end.starts, last.converged, end.iterations + last.iterations)
    return replace(refined, score=look_at(pairing, refined).score)


def _labels(scan: PointCloud, surfaces: Surfaces, pose: Transform) -> NDArray[np.uint8]:
    """Return for every point of the scan whether the map explains it."""
    labels = np.zeros(len(scan), dtype=np.uint8)
    for begin in range(0, len(scan), _BATCH):
        piece = slice(begin, begin + _BATCH)
        distance, _, found = surfaces.match(pose.apply(scan.points[piece]), None, reach=measure.REACH)
        labels[piece] = np.where(found & (np.abs(distance) < measure.INLIER_DISTANCE), REFERENCE, TARGET)
    return labels
