"""Whether the mirror image of a scan fits the map as well: some apps write a flipped axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.registration.evidence import Found, look_at
from worker.geometry.registration.neighbours import NeighbourGrid
from worker.geometry.registration.pairing import Pairing
from worker.geometry.registration.prepare import PreparedScan
from worker.geometry.registration.refine import refine_to_surfaces
from worker.geometry.registration.search import Outline, Region, search
from worker.geometry.registration.starts import End

_FLIPPED = np.array([1.0, -1.0, 1.0])
_MOST, _WORSE = 2, 0.1
_SAME_PLACE, _SAME_SIDE, _SAME_MAP = 0.15, 0.5, 0.95


def best_mirrored(pairing: Pairing, pose: Transform, *, region: Region | None, least: float) -> Found | None:
    """Return the best pose of the scan's mirror image, or None where it fits much less or tells nothing.

    A scan that is right is explained better than its mirror image, by where the doors are if by nothing else.
    On a map that is its own mirror image, such as the bare walls of a hall, it fits as well as the scan.

    Parameters
    ----------
    pairing : Pairing
        Of the scan, on a map of faces.
    pose : Transform
        `T_map_scan` that was found for the scan.
    region : Region, optional
        Where the tablet may have been; the image is turned any way in it. The whole map where there is none.
    least : float
        Score of the scan itself in a search; an image that scores 0.1 less is no rival.
    """
    scan = _mirrored(pairing.scan)
    mirrored = replace(pairing, scan=scan)
    anyhow = None if region is None else replace(region, turn=np.pi)
    hypotheses = search(scan.structure, pairing.target.outline, region=anyhow, thorough=False)
    worth = hypotheses.score >= least - _WORSE
    found = []
    for x, y, yaw in hypotheses.poses[worth][:_MOST]:
        start = Transform.from_xyz_yaw(x, y, float(pose.translation[2]), yaw)
        refined = refine_to_surfaces(
            scan.fine, scan.normals, mirrored.surfaces(start), initial=start, thorough=False
        )
        end = End(refined.T_map_scan, 0.0, 0, refined.converged, refined.iterations)
        found.append(look_at(mirrored, end))
    best = max(found, key=lambda f: f.score, default=None)
    if best is None or _is_mirrored_onto_itself(pairing.target.outline, pose, best.end.T_map_scan):
        return None
    return best


def _mirrored(scan: PreparedScan) -> PreparedScan:
    """Return a scan with its y axis turned round."""
    level, structure = _FLIPPED[:2], scan.structure
    return replace(
        scan,
        coarse=scan.coarse * _FLIPPED,
        fine=scan.fine * _FLIPPED,
        normals=scan.normals * _FLIPPED,
        viewpoint=scan.viewpoint * _FLIPPED,
        structure=replace(
            structure,
            xy=structure.xy * level,
            outward=structure.outward * level,
            viewpoint=structure.viewpoint * level,
        ),
    )


def _is_mirrored_onto_itself(outline: Outline, pose: Transform, mirrored: Transform) -> bool:
    """Return whether the reflection that takes a scan's place to its image's takes the map onto itself."""
    feet, outward = outline.samples
    back = pose.inverse()
    turn = mirrored.rotation @ np.diag(_FLIPPED) @ back.rotation
    shift = mirrored.rotation @ (_FLIPPED * back.translation) + mirrored.translation
    places, looks = (np.column_stack([level, np.zeros(len(level))]) for level in (feet, outward))
    images: NDArray[np.float64] = places @ turn.T + shift
    images[:, 2] = 0.0
    most = float(np.hypot(_SAME_PLACE, _SAME_SIDE))
    _, index = NeighbourGrid.of(places, looks).nearest(
        images, looks @ turn.T, reach=_SAME_PLACE, weight=1.0, most=most
    )
    return bool(np.mean(index >= 0) >= _SAME_MAP)
