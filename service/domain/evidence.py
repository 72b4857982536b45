"""What was measured about a placement: facts, from which `service.domain.acceptance` draws a verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from service.domain.gone import GoneLayer
from service.domain.measured import Measured
from service.domain.transform import Transform

MapKind = Literal["faces", "cloud"]


@dataclass(frozen=True)
class PlacementEvidence(Measured):
    """Hold the measurements of one placement; no single one of them tells whether the pose is right.

    Parameters
    ----------
    map_kind : {"faces", "cloud"}
        Whether the scan was fitted to exact wall faces, or to the points of a cloud.
    converged : bool
        Whether every stage that led to the pose came to rest before its iterations ran out.
    iterations : int
        Evaluations of the NDT objective and steps of the refinement together.
    points_compared : int
        Points of the thinned scan on which shares and residuals are measured.
    inlier_distance_m : float
        A point of the scan nearer than this to a surface of the map is an inlier.
    inlier_share : float
        Share of the compared points that are inliers. A target object, which the map lacks, lowers it.
    inlier_share_of_structure : float
        The same over upright surfaces above furniture height alone, the stuff of walls.
    residual_rms_m, residual_median_m : float
        Distance of the inliers to the map's surfaces. On a pose slid along a wall it is small as well.
    overlap_share : float
        Share of the compared points that have anything of the map within one `ndt_resolution`.
    euclidean_fitness_score_m2 : float
        PCL's definition, over all compared points; the paper accepts 0.038 on a 0.4 m map, and on that alone.
    transformation_probability : float
        PCL's definition at `ndt_resolution`; higher is better, and it does not rank poses on different maps.
    nearest_voxel_transformation_likelihood : float
        Autoware's definition at `ndt_resolution`: mean of the best Gaussian over the points that have one.
    ndt_resolution_m : float
        Edge of the NDT cells of the two numbers above.
    information_eigenvalues : tuple of 6 float
        Of the inliers' normal equations per point, turns scaled to metres at the scan's own size; ascending.
        One near 0 means that some motion changes nothing that was measured.
    weak_directions : tuple of str
        Motions that the inliers hardly determine: ``x``, ``y``, ``z``, ``yaw``, ``tilt``, or ``along <deg>``.
    position_sensitivity_m, yaw_sensitivity_rad : float
        How far the pose would move, at the scan's origin and in its worst level direction, if each wall stood
        3 cm and half a degree from where the map has it (one sigma). Residuals do not show this.
    covariance : tuple of 6 tuples of 6 float
        Of the pose: x, y, z of the scan's origin [m] and a rotation vector [rad], both in frame `map`, as the
        surfaces' own errors, sized by the residuals, leave it. The true pose lies within the ellipsoid
        ``e^T C^-1 e <= 12.59`` in about 95 of 100 accepted placements.
    position_std_m, yaw_std_rad : float
        Square roots of its worst level direction and of its turn about the vertical.
    contradicted_share : float
        Share of all points, floor and furniture too, that stand behind a wall of the map as seen from where
        the tablet was, and would if the wall stood 15 cm elsewhere. One carried through a door sees such
        things rightly; 0 on a cloud, which has no walls.
    astray_share : float
        Share of the upright structure that lies on no surface of the map and stands in no room of it either,
        as an object would: behind a wall, or where no wall follows. 0 on a cloud, which has no rooms.
    upright_surfaces : int
        Distinct upright planes of the map that the scan rests on; a corner has 2, three walls 3.
    closed_directions : int
        In how many directions two of them face each other, as opposite walls of a room do: 0, 1 or 2.
    undrawn_wall_share : float
        Largest share of the upright structure that stands on one upright plane without being on the map: a
        wall that the map lacks, or has elsewhere. Goods on shelves stand on many planes. 0 on a cloud.
    explained_share_at_top : float
        Share of the upright points in the uppermost 40 cm that are on the map: walls reach the ceiling, and
        what ends below it is an object. 1 on a cloud.
    slide_gain, slide_m : float or None
        Where a wall that faces no other alone holds the scan in a direction: by which share more of the rest
        of the scan would lie on the map 0.15 to 1.2 m farther along it, that wall left out, and where. More
        than next to nothing means that the wall stands elsewhere than drawn. None where walls face each
        other in both directions, and on a cloud.
    poses_compared : int
        Poses that the placement search compared before the best were refined.
    starts, starts_agreeing : int
        On a cloud with a rough pose: poses tried as starts of NDT, and how many ended at the pose given
        (within 0.1 m and 1 degree).
    runner_up_distance_m, runner_up_turn_rad : float or None
        The best pose that ended elsewhere: how far it is from the pose given.
    runner_up_inlier_share, runner_up_contradicted_share : float or None
        Its share of structure inliers, and that of points behind walls.
    mirrored_inlier_share, mirrored_contradicted_share : float or None
        The same of the scan's mirror image, where that fits best: near the scan's own it means that a flipped
        axis would not show. None where it fits much less, on a cloud, and where the map as a whole is its own
        mirror image.
    moved_m, turned_rad : float
        How far the placement went from the rough pose.
    tilt_rad : float
        Angle between the scan's z axis and the map's.
    gone : tuple of GoneLayer
        What the placed scan looked through, layer by layer: it seems to have gone.
    earlier : mapping of str to float, optional
        Measures that an earlier version made of this placement and this one does not make, by their names.
    """

    map_kind: MapKind
    converged: bool
    iterations: int
    points_compared: int
    inlier_distance_m: float
    inlier_share: float
    inlier_share_of_structure: float
    residual_rms_m: float
    residual_median_m: float
    overlap_share: float
    euclidean_fitness_score_m2: float
    transformation_probability: float
    nearest_voxel_transformation_likelihood: float
    ndt_resolution_m: float
    information_eigenvalues: tuple[float, ...]
    weak_directions: tuple[str, ...]
    position_sensitivity_m: float
    yaw_sensitivity_rad: float
    covariance: tuple[tuple[float, ...], ...]
    position_std_m: float
    yaw_std_rad: float
    contradicted_share: float
    astray_share: float
    upright_surfaces: int
    closed_directions: int
    undrawn_wall_share: float
    explained_share_at_top: float
    slide_gain: float | None
    slide_m: float | None
    poses_compared: int
    starts: int
    starts_agreeing: int
    runner_up_distance_m: float | None
    runner_up_turn_rad: float | None
    runner_up_inlier_share: float | None
    runner_up_contradicted_share: float | None
    mirrored_inlier_share: float | None
    mirrored_contradicted_share: float | None
    moved_m: float
    turned_rad: float
    tilt_rad: float
    gone: tuple[GoneLayer, ...] = ()
    earlier: Mapping[str, float] | None = None

    @classmethod
    def upgraded(cls, value: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return stored evidence with what no member names any more under `earlier`."""
        unnamed = {name: told for name, told in value.items() if name not in cls.__dataclass_fields__}
        return {**value, "earlier": unnamed} if unnamed else value


@dataclass(frozen=True, eq=False)
class Candidate(Measured):
    """Hold a pose that was refined, and what it explains of the scan.

    Parameters
    ----------
    T_map_scan : Transform
        4x4, row by row: takes coordinates of the scan to coordinates of the map [m].
    inlier_share_of_structure, inlier_share : float
        Shares of the upright structure, and of all points, that lie on the map there.
    starts : int
        How many starts ended there.
    """

    T_map_scan: Transform
    inlier_share_of_structure: float
    inlier_share: float
    starts: int
