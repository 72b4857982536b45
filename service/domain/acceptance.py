"""What a placement's evidence is worth: accepted, for a person to review, or rejected.

A scan placed 10 cm wrong makes a map worse than no scan at all, so every doubt asks for a review. The
paper's fitness threshold (0.038 m^2) belongs to one voxel size and one building: it is shown, not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from service.domain.evidence import PlacementEvidence

Verdict = Literal["accepted", "needs-review", "rejected"]


@dataclass(frozen=True)
class AcceptancePolicy:
    """Hold the limits between accepted, needs-review and rejected.

    Parameters
    ----------
    rejected_inlier_share, accepted_inlier_share, accepted_inlier_share_on_cloud : float
        Below the first a placement is rejected, below the second a person looks: share of upright
        structure that lies on the map's surfaces. On a cloud, which knows no walls, all that is upright is
        structure, and less of it is asked for.
    accepted_share_of_all : float
        Least share of all points on the map's surfaces.
    accepted_residual_m, accepted_residual_on_cloud_m : float
        Largest median distance of the inliers, to exact faces and to a cloud with its own noise.
    least_upright_surfaces : int
        Fewer distinct walls than this leave room for a wrong pose that fits as well.
    largest_contradicted_share : float
        More points than this behind walls of the map, as seen from where the tablet was, speak against the
        pose: of right ones there are none, but for what mirrors and windows make.
    largest_astray_share : float
        More structure than this on no wall and in no room of the map speaks against the pose: an object
        stands in a room, what a wrong pose leaves over often does not.
    largest_sensitivity_m : float
        Largest effect that walls drawn 3 cm and half a degree wrong may have on the position: more means
        that the drawing's own errors are magnified, unseen.
    closed_astray_share : float
        Where the scan lies between facing walls of the map in both directions, with no more than this and
        no contradiction against it, what is left over stands in that room: a full store hides most of its
        walls. Of wrong poses next to none is so.
    closed_inlier_share, closed_share_of_all, closed_residual_m, closed_sensitivity_m, closed_rival : float
        What is asked there in place of the other limits; a rival explains this much of what the pose does.
    closed_share_at_top : float
        So much of what reaches the top is on the map: else the map lacks walls, or has them elsewhere.
    furnished_inlier_share : float
        What is asked of the structure where walls of the map close the room in one direction, a third one
        holds the other, and what is left over are objects that hide walls, standing freely in the room.
    furnished_undrawn_share, furnished_share_at_top : float
        They are objects where no more than this of the structure stands on one plane, and at least this share
        of what reaches the top is on the map. Left-over walls of wrong poses never are.
    mirror_lead : float
        A mirror image of the scan that explains this share more of the structure is a rival; below 0, one
        that fits as well is enough. Either the file has a flipped axis, or the room is its own mirror image
        and cannot tell.
    runner_up_margin : float
        A runner-up that explains the structure but for this share as well as the pose makes it ambiguous; of
        a pose that leaves structure unexplained, half of that more is asked.
    free_rival_margin : float
        The margin for a runner-up that nothing is seen through walls at.
    contradiction_weight, closed_contradiction_weight : float
        What a share of points behind walls takes off an explained share, where poses are compared.
    largest_slide_gain : float
        Where a lone wall holds the scan in a direction, more than this of the rest of the scan won by sliding
        along it speaks against that wall.
    least_agreement : float
        Least share of the starts that end at the pose.
    largest_move_m, largest_turn_rad, largest_tilt_rad : float
        Farther from the rough pose, or more tilted, a person looks.
    """

    rejected_inlier_share: float = 0.35
    accepted_inlier_share: float = 0.9
    accepted_inlier_share_on_cloud: float = 0.6
    accepted_share_of_all: float = 0.4
    accepted_residual_m: float = 0.02
    accepted_residual_on_cloud_m: float = 0.03
    least_upright_surfaces: int = 3
    largest_contradicted_share: float = 0.0015
    largest_astray_share: float = 0.04
    largest_sensitivity_m: float = 0.045
    closed_astray_share: float = 0.01
    closed_inlier_share: float = 0.15
    closed_share_of_all: float = 0.25
    closed_residual_m: float = 0.04
    closed_sensitivity_m: float = 0.06
    closed_rival: float = 0.7
    closed_share_at_top: float = 0.9
    furnished_inlier_share: float = 0.65
    furnished_undrawn_share: float = 0.07
    furnished_share_at_top: float = 0.965
    mirror_lead: float = -0.0005
    runner_up_margin: float = 0.1
    free_rival_margin: float = 0.2
    contradiction_weight: float = 2.0
    closed_contradiction_weight: float = 10.0
    largest_slide_gain: float = 0.01
    least_agreement: float = 0.4
    largest_move_m: float = 3.5
    largest_turn_rad: float = math.radians(50.0)
    largest_tilt_rad: float = math.radians(5.0)


@dataclass(frozen=True)
class Judgement:
    """Hold a verdict and, as sentences, what led to it."""

    verdict: Verdict
    reasons: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the judgement as a JSON object."""
        return {"verdict": self.verdict, "reasons": list(self.reasons)}


def judge(evidence: PlacementEvidence, policy: AcceptancePolicy | None = None) -> Judgement:
    """Return the verdict on a placement and the reasons for it.

    ``accepted`` is given only when nothing speaks against the pose. It is still no proof: a map that is
    wrong in the same way as the scan is not noticed, nor is a wall drawn elsewhere where no other one checks
    it, as the end wall of three; the reasons say where that is so.

    Parameters
    ----------
    evidence : PlacementEvidence
        What was measured.
    policy : AcceptancePolicy, optional
        The limits; the product's own if not given.
    """
    policy = policy or AcceptancePolicy()
    against = _fatal(evidence, policy)
    if against:
        return Judgement("rejected", tuple(against))
    doubts = _fit_doubts(evidence, policy) + _uniqueness_doubts(evidence, policy)
    if doubts:
        return Judgement("needs-review", tuple(doubts))
    share, median = evidence.inlier_share_of_structure, evidence.residual_median_m
    return Judgement(
        "accepted",
        (
            f"{share:.0%} of the scanned structure lies on the map, {median:.3f} m off in the median.",
            f"{evidence.upright_surfaces} distinct upright surfaces hold the pose in every direction.",
            _alone(evidence),
            *_unchecked(evidence),
        ),
    )


def _unchecked(e: PlacementEvidence) -> list[str]:
    """Return where an accepted pose rests on a wall that hardly anything checks."""
    if e.slide_gain is None:
        return []
    told = (
        "In one direction no two walls face each other in the scan: if the only wall there stands elsewhere "
        "than drawn, so does the scan, and only doors and ends of other walls could tell."
    )
    return [told]


def _closed(e: PlacementEvidence, policy: AcceptancePolicy) -> bool:
    """Return whether facing walls of the map hold the scan both ways, and nothing speaks against it."""
    return (
        e.closed_directions == 2
        and e.contradicted_share <= policy.largest_contradicted_share
        and e.astray_share <= policy.closed_astray_share
        and e.explained_share_at_top >= policy.closed_share_at_top
    )


def _furnished(e: PlacementEvidence, policy: AcceptancePolicy) -> bool:
    """Return whether three walls of the map hold the scan, and what is left over are objects among them."""
    return (
        e.map_kind == "faces"
        and e.closed_directions >= 1
        and e.upright_surfaces >= policy.least_upright_surfaces
        and e.contradicted_share <= policy.largest_contradicted_share
        and e.astray_share <= policy.closed_astray_share
        and e.undrawn_wall_share <= policy.furnished_undrawn_share
        and e.explained_share_at_top >= policy.furnished_share_at_top
    )


def _alone(e: PlacementEvidence) -> str:
    """Return what was done to find another pose that fits."""
    if e.starts:
        return f"{e.starts_agreeing} of {e.starts} starts ended at this pose."
    return f"Of {e.poses_compared} poses compared no other fits nearly as well."


def _fatal(e: PlacementEvidence, policy: AcceptancePolicy) -> list[str]:
    """Return what shows that the pose is wrong or means nothing."""
    reasons = []
    if e.points_compared < 100:
        reasons.append(f"Only {e.points_compared} points could be compared; a scan has thousands.")
    if e.inlier_share_of_structure < policy.rejected_inlier_share and not _closed(e, policy):
        reasons.append(
            f"Only {e.inlier_share_of_structure:.0%} of the scanned structure lies within "
            f"{e.inlier_distance_m:.2f} m of the map: the scan is not of this place, "
            "or the rough pose is too far off."
        )
    return reasons


def _fit_doubts(e: PlacementEvidence, policy: AcceptancePolicy) -> list[str]:
    """Return what speaks against the fit itself."""
    doubts = []
    if not e.converged:
        doubts.append("The placement had not come to rest when its iterations ran out.")
    faces, closed = e.map_kind == "faces", _closed(e, policy)
    expected = policy.accepted_inlier_share if faces else policy.accepted_inlier_share_on_cloud
    if _furnished(e, policy):
        expected = policy.furnished_inlier_share
    expected = policy.closed_inlier_share if closed else expected
    expected_of_all = policy.closed_share_of_all if closed else policy.accepted_share_of_all
    if e.inlier_share_of_structure < expected:
        doubts.append(
            f"{e.inlier_share_of_structure:.0%} of the scanned structure lies on the map; "
            f"{expected:.0%} are expected of a right pose."
        )
    if e.inlier_share < expected_of_all:
        doubts.append(
            f"{e.inlier_share:.0%} of all points lie on the map; {expected_of_all:.0%} are expected."
        )
    residual = policy.accepted_residual_m if faces else policy.accepted_residual_on_cloud_m
    if not e.residual_median_m <= (policy.closed_residual_m if closed else residual):
        doubts.append(
            f"The points lie {e.residual_median_m:.3f} m off the map in the median: the scan is bent, "
            "or the drawing differs from the building."
        )
    if e.contradicted_share > policy.largest_contradicted_share:
        doubts.append(
            f"{e.contradicted_share:.1%} of the points would have been seen through the map's walls."
        )
    if e.astray_share > policy.largest_astray_share:
        doubts.append(f"{e.astray_share:.0%} of the scanned structure stands in no room of the map.")
    if e.tilt_rad > policy.largest_tilt_rad:
        doubts.append(f"The scan had to be tilted by {math.degrees(e.tilt_rad):.1f} degrees.")
    return doubts


def _rivalled(e: PlacementEvidence, policy: AcceptancePolicy) -> bool:
    """Return whether the runner-up explains the scan nearly as well, or would if walls were glass."""
    if e.runner_up_inlier_share is None:
        return False
    closed, seen_through = _closed(e, policy), e.runner_up_contradicted_share or 0.0
    if e.runner_up_inlier_share > e.inlier_share_of_structure:
        return True
    weight = policy.closed_contradiction_weight if closed else policy.contradiction_weight
    here = e.inlier_share_of_structure - weight * e.contradicted_share
    there = e.runner_up_inlier_share - weight * seen_through
    margin = policy.runner_up_margin + (1.0 - e.inlier_share_of_structure) / 2.0
    if seen_through <= policy.largest_contradicted_share:
        margin = max(margin, policy.free_rival_margin)
    if closed:
        margin = min(margin, (1.0 - policy.closed_rival) * here)
    return there > here - margin


def _mirrored(e: PlacementEvidence, policy: AcceptancePolicy) -> bool:
    """Return whether the scan's mirror image fits as well as the scan, so that it may be one itself."""
    if e.mirrored_inlier_share is None:
        return False
    weight = policy.closed_contradiction_weight
    here = e.inlier_share_of_structure - weight * e.contradicted_share
    there = e.mirrored_inlier_share - weight * (e.mirrored_contradicted_share or 0.0)
    return there > here + policy.mirror_lead


def _uniqueness_doubts(e: PlacementEvidence, policy: AcceptancePolicy) -> list[str]:
    """Return what leaves room for another pose."""
    doubts = []
    closed = _closed(e, policy)
    held = closed or _furnished(e, policy)
    if e.weak_directions:
        doubts.append(f"What was scanned does not hold the pose in: {', '.join(e.weak_directions)}.")
    if e.upright_surfaces < policy.least_upright_surfaces and not closed:
        doubts.append(
            f"The scan rests on {e.upright_surfaces} upright surfaces; with fewer than "
            f"{policy.least_upright_surfaces} another corner fits as well. Scan a third wall."
        )
    if not e.position_sensitivity_m <= (
        policy.closed_sensitivity_m if held else policy.largest_sensitivity_m
    ):
        doubts.append(
            "The walls seen hold the position from too few sides: "
            "if they stand 3 cm from where the map has them, "
            f"it is {e.position_sensitivity_m * 100:.1f} cm off. Scan more of the room."
        )
    if e.slide_gain is not None and e.slide_gain > policy.largest_slide_gain:
        doubts.append(
            f"In one direction a single wall holds the scan. Without it, {e.slide_gain:.0%} more of the scan "
            f"would lie on the map {abs(e.slide_m or 0.0):.2f} m farther: the wall may stand elsewhere than "
            "drawn."
        )
    if _rivalled(e, policy):
        doubts.append(
            f"Another pose, {e.runner_up_distance_m or 0.0:.2f} m and "
            f"{math.degrees(e.runner_up_turn_rad or 0.0):.1f} degrees away, fits almost as well."
        )
    if _mirrored(e, policy):
        doubts.append(
            "The scan's mirror image fits as well or better: its file may have a flipped axis, or the room "
            "is its own mirror image. See that left and right are right, or scan more of the room."
        )
    if e.starts_agreeing < policy.least_agreement * e.starts:
        doubts.append(f"Only {e.starts_agreeing} of {e.starts} starts ended at this pose.")
    if e.moved_m > policy.largest_move_m or e.turned_rad > policy.largest_turn_rad:
        doubts.append(
            f"The pose found lies {e.moved_m:.1f} m and {math.degrees(e.turned_rad):.0f} degrees "
            "from the rough pose."
        )
    return doubts
