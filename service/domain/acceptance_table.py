"""The table of acceptance: what is measured of a placement, what is asked of it, and how that is known.

Each number stands here alone; `service.domain.acceptance` reads the table and knows none. The trials are
those of ``poe bench`` (`tests/benchmarks/test_placement_trials.py`, whose kinds are named here in quotes, and
`test_store_map.py`), run while the limits were set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["accepted", "needs-review", "rejected"]
Regime = Literal["faces", "cloud", "furnished", "closed"]


@dataclass(frozen=True, kw_only=True)
class Limit:
    """Hold a row: a measure, the least or the most of it that a right pose has, and what it says if not.

    Parameters
    ----------
    code : str
        The row's name.
    measure : str
        A member of `PlacementEvidence`, or a measure that `service.domain.acceptance` derives from some.
    asked : {"at least", "at most"}
        On which side of the limit a right pose lies; one on it is right, a measure that is no number never.
    unit : str
        Of the measure and its limits.
    limits : mapping of Regime to float
        ``closed``: walls of the map that face each other hold the scan in both directions and nothing speaks
        against the pose, so that what is left over stands in that room: a full store hides most of its walls.
        Of wrong poses next to none is so. ``furnished``: they close the room in one direction, a third wall
        holds the other, and what is left over are objects that hide walls, standing freely in the room.
        Otherwise the kind of the map. Nothing is asked where a regime is missing.
    sentence : str
        Told of a measure beyond the limit; empty where that only keeps the scan out of a regime.
    verdict : {"needs-review", "rejected"}
        What follows then.
    opens : tuple of Regime
        The regimes that a scan is in only where this limit of theirs is kept.
    trials : str
        Where the numbers come from.
    """

    code: str
    measure: str
    asked: Literal["at least", "at most"]
    unit: str
    limits: Mapping[Regime, float]
    sentence: str = ""
    verdict: Verdict = "needs-review"
    opens: tuple[Regime, ...] = ()
    trials: str

    @property
    def limit_key(self) -> str:
        """Return the name of the limit among a reason's values, with its unit: ``limit_share``."""
        return f"limit_{self.unit.partition(' ')[0]}"

    @property
    def measure_key(self) -> str:
        """Return the name of the measure among a reason's values: its own, with the unit where it lacks."""
        is_bare_share = self.unit.startswith("share") and "share" not in self.measure
        return f"{self.measure}_share" if is_bare_share else self.measure

    def is_kept(self, value: float | None, regime: Regime) -> bool:
        """Return whether a right pose may have this value; one that was not measured speaks against none."""
        limit = self.limits.get(regime)
        if limit is None or value is None:
            return True
        return value >= limit if self.asked == "at least" else value <= limit


@dataclass(frozen=True, kw_only=True)
class Support:
    """Hold a reason of an accepted pose: its code, and the sentence that names what it rests on."""

    code: str
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Factor:
    """Hold a number by which poses are compared: its code, unit, value by regime, use, and trials."""

    code: str
    unit: str
    values: Mapping[Regime, float]
    use: str
    trials: str


def _by_regime(everywhere: float, **otherwise: float | None) -> dict[Regime, float]:
    """Return a number for each regime; None where nothing is asked."""
    regimes: tuple[Regime, ...] = ("faces", "cloud", "furnished", "closed")
    numbers = ((regime, otherwise.get(regime, everywhere)) for regime in regimes)
    return {regime: number for regime, number in numbers if number is not None}


_ANOTHER_POSE = (
    "Another pose, {runner_up_away_m:.2f} m and {runner_up_away_deg:.1f} degrees away, fits almost as well."
)
_FAR = "The pose found lies {moved_m:.1f} m and {turned_deg:.0f} degrees from the rough pose."

TABLE: tuple[Limit, ...] = (
    Limit(
        code="few-points",
        measure="points_compared",
        asked="at least",
        unit="points",
        limits=_by_regime(100),
        sentence="Only {points_compared} points could be compared; a scan has thousands.",
        verdict="rejected",
        trials="None: a share of fewer is no measure, and a scan has thousands.",
    ),
    Limit(
        code="another-place",
        measure="inlier_share_of_structure",
        asked="at least",
        unit="share of the upright structure",
        limits=_by_regime(0.35, closed=None),
        sentence="Only {inlier_share_of_structure:.0%} of the scanned structure lies within "
        "{inlier_distance_m:.2f} m of the map: the scan is not of this place, or the rough pose is too far "
        "off.",
        verdict="rejected",
        trials='"another building": what explains less is of another place.',
    ),
    Limit(
        code="not-at-rest",
        measure="converged",
        asked="at least",
        unit="truth (1 if it came to rest)",
        limits=_by_regime(1),
        sentence="The placement had not come to rest when its iterations ran out.",
        trials="None: a pose that still moves is not the one that was looked for.",
    ),
    Limit(
        code="structure-unexplained",
        measure="inlier_share_of_structure",
        asked="at least",
        unit="share of the upright structure",
        # A cloud knows no walls: all that is upright is structure, and less of it is asked for.
        limits=_by_regime(0.9, cloud=0.6, furnished=0.65, closed=0.15),
        sentence="{inlier_share_of_structure:.0%} of the scanned structure lies on the map; {limit:.0%} are "
        "expected of a right pose.",
        trials='880 of all kinds, in which "three walls" have to explain more than 0.8; objects among walls '
        "and a full store of test_store_map.py for what furniture and goods may hide.",
    ),
    Limit(
        code="points-unexplained",
        measure="inlier_share",
        asked="at least",
        unit="share of all points",
        limits=_by_regime(0.4, closed=0.25),
        sentence="{inlier_share:.0%} of all points lie on the map; {limit:.0%} are expected.",
        trials='"whole room" and "three walls" with objects; test_store_map.py for a full store.',
    ),
    Limit(
        code="residual",
        measure="residual_median_m",
        asked="at most",
        unit="m",
        # A cloud has noise of its own; a scan held from both sides may be bent.
        limits=_by_regime(0.02, cloud=0.03, closed=0.04),
        sentence="The points lie {residual_median_m:.3f} m off the map in the median: the scan is bent, or "
        "the drawing differs from the building.",
        trials='"1 % scale", "1.5 degrees bent", "three walls, both".',
    ),
    Limit(
        code="seen-through-walls",
        measure="contradicted_share",
        asked="at most",
        unit="share of all points",
        limits=_by_regime(0.0015),
        sentence="{contradicted_share:.1%} of the points would have been seen through the map's walls.",
        opens=("furnished", "closed"),
        trials="880 of all kinds: of right poses there are none, but for what mirrors and windows make; "
        "of wrong ones that fit the walls mostly over 0.01.",
    ),
    Limit(
        code="astray",
        measure="astray_share",
        asked="at most",
        unit="share of the upright structure",
        # An object stands in a room; what a wrong pose leaves over often does not.
        limits=_by_regime(0.04, furnished=0.01, closed=0.01),
        sentence="{astray_share:.0%} of the scanned structure stands in no room of the map.",
        opens=("furnished", "closed"),
        trials='"wall moved", "room not drawn", "another building".',
    ),
    Limit(
        code="tilted",
        measure="tilt_rad",
        asked="at most",
        unit="rad",
        limits=_by_regime(math.radians(5.0)),
        sentence="The scan had to be tilted by {tilt_deg:.1f} degrees.",
        trials="None: a scan is levelled by its floor before it is placed.",
    ),
    Limit(
        code="closed-directions",
        measure="closed_directions",
        asked="at least",
        unit="directions",
        limits={"furnished": 1, "closed": 2},
        opens=("furnished", "closed"),
        trials="test_store_map.py: walls that face each other hold a scan, though goods hide most of them.",
    ),
    Limit(
        code="wall-undrawn",
        measure="undrawn_wall_share",
        asked="at most",
        unit="share of the upright structure",
        limits={"furnished": 0.07},
        opens=("furnished",),
        trials='"room not drawn", "wall moved": left-over walls stand on one plane, objects on many.',
    ),
    Limit(
        code="top-unexplained",
        measure="explained_share_at_top",
        asked="at least",
        unit="share of what reaches the top",
        limits={"furnished": 0.965, "closed": 0.9},
        opens=("furnished", "closed"),
        trials='"room not drawn", "wall moved": else the map lacks walls, or has them elsewhere.',
    ),
    Limit(
        code="not-held",
        measure="weak_directions_count",
        asked="at most",
        unit="motions",
        limits=_by_regime(0),
        sentence="What was scanned does not hold the pose in: {weak_directions_named}.",
        trials="None: a motion that changes nothing that was measured leaves the pose open.",
    ),
    Limit(
        code="few-walls",
        measure="upright_surfaces",
        asked="at least",
        unit="surfaces (distinct upright planes)",
        limits=_by_regime(3, closed=None),
        sentence="The scan rests on {upright_surfaces} upright surfaces; with fewer than {limit} another "
        "corner fits as well. Scan a third wall.",
        opens=("furnished",),
        trials='"bare corner": fewer leave room for a wrong pose that fits as well.',
    ),
    Limit(
        code="sensitive",
        measure="position_sensitivity_m",
        asked="at most",
        unit="m",
        limits=_by_regime(0.045, furnished=0.06, closed=0.06),
        sentence="The walls seen hold the position from too few sides: if they stand 3 cm from where the map "
        "has them, it is {position_sensitivity_cm:.1f} cm off. Scan more of the room.",
        trials='"bare corner" and "three walls" on walls drawn 3 cm and half a degree wrong: more means that '
        "the drawing's own errors are magnified, unseen.",
    ),
    Limit(
        code="lone-wall",
        measure="slide_gain",
        asked="at most",
        unit="share of the scan",
        limits=_by_regime(0.01),
        sentence="In one direction a single wall holds the scan. Without it, {slide_gain:.0%} more of the "
        "scan would lie on the map {slide_away_m:.2f} m farther: the wall may stand elsewhere than drawn.",
        trials='"three walls" with the lone wall as drawn and elsewhere.',
    ),
    Limit(
        code="runner-up",
        measure="runner_up_excess",
        asked="at most",
        unit="share of the upright structure",
        limits=_by_regime(0),
        sentence=_ANOTHER_POSE,
        trials="The factors say how much the runner-up has to explain.",
    ),
    Limit(
        code="mirror-image",
        measure="mirror_lead",
        asked="at most",
        unit="share of the upright structure",
        # Below 0: an image that fits as well is enough, since a room that is its own image cannot tell.
        limits=_by_regime(-0.0005),
        sentence="The scan's mirror image fits as well or better: its file may have a flipped axis, or the "
        "room is its own mirror image. See that left and right are right, or scan more of the room.",
        trials='"mirrored" against "whole room" and "three walls".',
    ),
    Limit(
        code="starts-disagree",
        measure="starts_agreeing_share",
        asked="at least",
        unit="share of the starts",
        limits=_by_regime(0.4),
        sentence="Only {starts_agreeing} of {starts} starts ended at this pose.",
        trials="Placements on bare clouds from rough poses give or take 3 m and 45 degrees.",
    ),
    Limit(
        code="moved-far",
        measure="moved_m",
        asked="at most",
        unit="m",
        limits=_by_regime(3.5),
        sentence=_FAR,
        trials="None: a rough pose is given give or take 3 m; a little more is let pass.",
    ),
    Limit(
        code="turned-far",
        measure="turned_rad",
        asked="at most",
        unit="rad",
        limits=_by_regime(math.radians(50.0)),
        sentence=_FAR,
        trials="None: a rough pose is given give or take 45 degrees; a little more is let pass.",
    ),
)
"""Every limit, in the order in which reasons are told; two that share a sentence say it once."""

CONTRADICTION_WEIGHT = Factor(
    code="contradiction-weight",
    unit="share of the structure for each share of the points",
    values=_by_regime(2.0, closed=10.0),
    use="What points behind walls take off an explained share; mirror images are weighed as in `closed`.",
    trials="test_store_map.py: rivals that see through walls are none.",
)
RUNNER_UP_MARGIN = Factor(
    code="runner-up-margin",
    unit="share of the upright structure",
    values=_by_regime(0.1),
    use="A runner-up that explains the structure but for this as well as the pose makes it ambiguous.",
    trials="Trials of all kinds in buildings with like rooms.",
)
UNEXPLAINED_PART = Factor(
    code="unexplained-part",
    unit="share of what the pose leaves unexplained",
    values=_by_regime(0.5),
    use="Asked beside the margin of a pose that leaves structure unexplained.",
    trials="As of the margin.",
)
FREE_RIVAL_MARGIN = Factor(
    code="free-rival-margin",
    unit="share of the upright structure",
    values=_by_regime(0.2),
    use="The margin for a runner-up that nothing is seen through walls at.",
    trials="As of the margin, and full warehouses.",
)
CLOSED_RIVAL = Factor(
    code="closed-rival",
    unit="share of what the pose explains",
    values={"closed": 0.7},
    use="A runner-up in a closed room explains at least this; the margin is no wider.",
    trials="test_store_map.py.",
)
FACTORS = (CONTRADICTION_WEIGHT, RUNNER_UP_MARGIN, UNEXPLAINED_PART, FREE_RIVAL_MARGIN, CLOSED_RIVAL)
"""Every number of the comparison with the runner-up and the mirror image."""

ON_THE_MAP = Support(
    code="structure-on-the-map",
    sentence="{inlier_share_of_structure:.0%} of the scanned structure lies on the map, "
    "{residual_median_m:.3f} m off in the median.",
)
HELD = Support(
    code="held-by-surfaces",
    sentence="{upright_surfaces} distinct upright surfaces hold the pose in every direction.",
)
STARTS_AGREE = Support(
    code="starts-agree", sentence="{starts_agreeing} of {starts} starts ended at this pose."
)
NO_RIVAL = Support(
    code="no-rival", sentence="Of {poses_compared} poses compared no other fits nearly as well."
)
UNCHECKED_WALL = Support(
    code="lone-wall-unchecked",
    sentence="In one direction no two walls face each other in the scan: if the only wall there stands "
    "elsewhere than drawn, so does the scan, and only doors and ends of other walls could tell.",
)
SUPPORTS = (ON_THE_MAP, HELD, STARTS_AGREE, NO_RIVAL, UNCHECKED_WALL)
"""What an accepted pose can rest on."""
