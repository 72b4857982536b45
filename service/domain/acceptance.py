"""What a placement's evidence is worth: accepted, for a person to review, or rejected.

A scan placed 10 cm wrong makes a map worse than no scan at all, so every doubt asks for a review. The
paper's fitness threshold (0.038 m^2) belongs to one voxel size and one building: it is shown, not used.
Every number stands in `service.domain.acceptance_table`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.domain.acceptance_table import (
    CLOSED_RIVAL,
    CONTRADICTION_WEIGHT,
    FREE_RIVAL_MARGIN,
    HELD,
    NO_RIVAL,
    ON_THE_MAP,
    RUNNER_UP_MARGIN,
    STARTS_AGREE,
    TABLE,
    UNCHECKED_WALL,
    UNEXPLAINED_PART,
    Limit,
    Regime,
    Verdict,
)
from service.domain.evidence import PlacementEvidence
from service.domain.reasons import Reason, names_in

_MEASURED_AS = {
    "weak_directions_named": "weak_directions",
    "position_sensitivity_cm": "position_sensitivity_m",
    "slide_away_m": "slide_m",
    "runner_up_away_m": "runner_up_distance_m",
    "runner_up_away_deg": "runner_up_turn_rad",
    "turned_deg": "turned_rad",
    "tilt_deg": "tilt_rad",
}
"""What a sentence shows otherwise than it is measured."""

_SEEN_THROUGH = next(row for row in TABLE if row.measure == "contradicted_share")


@dataclass(frozen=True)
class Judgement:
    """Hold a verdict, and what led to it."""

    verdict: Verdict
    reasons: tuple[Reason, ...]

    def to_json(self) -> dict[str, Any]:
        """Return the judgement as a JSON object."""
        return {"verdict": self.verdict, "reasons": [reason.to_json() for reason in self.reasons]}


def judge(evidence: PlacementEvidence) -> Judgement:
    """Return the verdict on a placement and the reasons for it.

    ``accepted`` is given only when nothing speaks against the pose. It is still no proof: a map that is
    wrong in the same way as the scan is not noticed, nor is a wall drawn elsewhere where no other one checks
    it, as the end wall of three; the reasons say where that is so.
    """
    measures = _measures(evidence)
    regime = _regime(evidence, measures)
    measures["runner_up_excess"] = _runner_up_excess(evidence, regime)
    broken = [row for row in TABLE if row.sentence and not row.is_kept(measures[row.measure], regime)]
    for verdict in ("rejected", "needs-review"):
        told = [_reason(row, measures, regime) for row in broken if row.verdict == verdict]
        if told:
            sentences = [reason.detail for reason in told]
            return Judgement(verdict, tuple(told[sentences.index(one)] for one in dict.fromkeys(sentences)))
    return Judgement("accepted", tuple(_in_favour(evidence, measures)))


def _reason(row: Limit, measures: Mapping[str, Any], regime: Regime) -> Reason:
    """Return what a measure beyond its limit says: what the sentence shows, in SI units, and the limit."""
    limit = row.limits[regime]
    values = {row.measure_key: measures[row.measure], row.limit_key: limit}
    return Reason(
        code=row.code,
        values=values | _shown(row.sentence, measures, without=row.measure),
        detail=row.sentence.format(**measures, limit=limit),
    )


def _shown(sentence: str, measures: Mapping[str, Any], *, without: str = "") -> dict[str, Any]:
    names = [_MEASURED_AS.get(name, name) for name in names_in(sentence)]
    return {name: measures[name] for name in names if name not in ("limit", without)}


def _measures(e: PlacementEvidence) -> dict[str, Any]:
    """Return what the table's rows and sentences name."""
    weight = CONTRADICTION_WEIGHT.values["closed"]
    here = e.inlier_share_of_structure - weight * e.contradicted_share
    image = e.mirrored_inlier_share
    return vars(e) | {
        "weak_directions_count": len(e.weak_directions),
        "weak_directions_named": ", ".join(e.weak_directions),
        "position_sensitivity_cm": e.position_sensitivity_m * 100,
        "slide_away_m": abs(e.slide_m or 0.0),
        "runner_up_away_m": e.runner_up_distance_m or 0.0,
        "runner_up_away_deg": math.degrees(e.runner_up_turn_rad or 0.0),
        "mirror_lead": None
        if image is None
        else image - weight * (e.mirrored_contradicted_share or 0.0) - here,
        "starts_agreeing_share": e.starts_agreeing / e.starts if e.starts else None,
        "turned_deg": math.degrees(e.turned_rad),
        "tilt_deg": math.degrees(e.tilt_rad),
    }


def _regime(e: PlacementEvidence, measures: Mapping[str, Any]) -> Regime:
    """Return what holds the scan: facing walls both ways, three walls among objects, or what is usual."""
    regimes: tuple[Regime, ...] = ("closed", "furnished") if e.map_kind == "faces" else ("closed",)
    for regime in regimes:
        if all(row.is_kept(measures[row.measure], regime) for row in TABLE if regime in row.opens):
            return regime
    return e.map_kind


def _runner_up_excess(e: PlacementEvidence, regime: Regime) -> float | None:
    """Return how much more the runner-up explains than one that is no rival would; above 0 it is one.

    It is one as well where it would explain more than the pose if walls were glass.
    """
    share, there = e.inlier_share_of_structure, e.runner_up_inlier_share
    if there is None:
        return None
    weight, seen_through = CONTRADICTION_WEIGHT.values[regime], e.runner_up_contradicted_share or 0.0
    explained = share - weight * e.contradicted_share
    margin = RUNNER_UP_MARGIN.values[regime] + UNEXPLAINED_PART.values[regime] * (1.0 - share)
    if _SEEN_THROUGH.is_kept(seen_through, regime):
        margin = max(margin, FREE_RIVAL_MARGIN.values[regime])
    if regime == "closed":
        margin = min(margin, (1.0 - CLOSED_RIVAL.values[regime]) * explained)
    return max(there - share, there - weight * seen_through - (explained - margin))


def _in_favour(e: PlacementEvidence, measures: Mapping[str, Any]) -> list[Reason]:
    """Return what an accepted pose rests on."""
    supports = [ON_THE_MAP, HELD, STARTS_AGREE if e.starts else NO_RIVAL]
    if e.slide_gain is not None:  # it rests on a wall that hardly anything checks
        supports.append(UNCHECKED_WALL)
    return [
        Reason(one.code, _shown(one.sentence, measures), detail=one.sentence.format(**measures))
        for one in supports
    ]
