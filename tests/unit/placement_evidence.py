"""Evidence that nothing speaks against, one for each way in which a scan is held."""

from __future__ import annotations

from dataclasses import replace

from service.domain.evidence import PlacementEvidence

GOOD = PlacementEvidence(
    map_kind="faces", converged=True, iterations=80, points_compared=6000, inlier_distance_m=0.1,
    inlier_share=0.9, inlier_share_of_structure=0.95, residual_rms_m=0.02, residual_median_m=0.006,
    overlap_share=0.99, euclidean_fitness_score_m2=0.02, transformation_probability=1.9,
    nearest_voxel_transformation_likelihood=1.7, ndt_resolution_m=1.0,
    information_eigenvalues=(0.08, 0.1, 0.1, 0.2, 0.2, 0.3), weak_directions=(),
    position_sensitivity_m=0.022, yaw_sensitivity_rad=0.005,
    covariance=((1e-4, 0.0, 0.0, 0.0, 0.0, 0.0),) * 6, position_std_m=0.01, yaw_std_rad=0.002,
    contradicted_share=0.0, astray_share=0.0,
    upright_surfaces=5,
    closed_directions=1,
    undrawn_wall_share=0.05,
    explained_share_at_top=0.9,
    slide_gain=None, slide_m=None,
    poses_compared=0, starts=7, starts_agreeing=7, runner_up_distance_m=None, runner_up_turn_rad=None,
    runner_up_inlier_share=None, runner_up_contradicted_share=None,
    mirrored_inlier_share=None, mirrored_contradicted_share=None,
    moved_m=0.5, turned_rad=0.14, tilt_rad=0.002,
)  # fmt: skip

CLEAN: dict[str, PlacementEvidence] = {
    "faces": GOOD,
    "cloud": replace(
        GOOD, map_kind="cloud", closed_directions=0, undrawn_wall_share=0.0, explained_share_at_top=1.0
    ),
    "furnished": replace(
        GOOD, inlier_share_of_structure=0.75, upright_surfaces=3, explained_share_at_top=0.99
    ),
    "closed": replace(
        GOOD,
        inlier_share_of_structure=0.3,
        inlier_share=0.3,
        closed_directions=2,
        explained_share_at_top=0.95,
    ),
}
"""A usual scan of walls, one on a bare cloud, one of three walls among objects, one of a full store."""
