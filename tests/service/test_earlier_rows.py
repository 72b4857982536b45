"""Rows as earlier versions wrote them are shown, each member in the form that the API describes now."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import httpx
import pytest

from service.db.models import Drawing, Placement, Publication, Revision, Scan
from service.db.proposals import Proposal
from service.domain.evidence import PlacementEvidence
from service.domain.recipe import Recipe
from service.domain.report import BuiltLayer
from tests.service.asking import a_map, a_placement, a_ready_revision, ok, refused
from tests.service.by_hand import IDENTITY, ByHand

SLUG = "placement-not-acceptable"

FIRST_EVIDENCE = {
    "map_kind": "faces", "converged": True, "iterations": 61, "points_compared": 8123,
    "inlier_distance_m": 0.1, "inlier_share": 0.71, "inlier_share_of_structure": 0.93,
    "residual_rms_m": 0.031, "residual_median_m": 0.012, "overlap_share": 0.97,
    "euclidean_fitness_score_m2": 0.017, "transformation_probability": 2.4,
    "nearest_voxel_transformation_likelihood": 2.1, "ndt_resolution_m": 1.0,
    "information_eigenvalues": [0.1, 0.2, 0.3, 0.4, None, 0.9], "weak_directions": ["along 12"],
    "upright_surfaces": 3, "starts": 7, "starts_agreeing": 6, "runner_up_distance_m": None,
    "runner_up_turn_rad": None, "runner_up_inlier_share": None, "moved_m": 0.4, "turned_rad": 0.02,
    "tilt_rad": 0.001,
}  # fmt: skip
"""Of the first placements, before covariances."""

WALKS_EXCUSED = {
    **FIRST_EVIDENCE,
    "unreachable_share": 0.01,
    "self_hidden_share": 0.002,
    "covariance": [[None] * 6] * 6,
    "gone": [{"layer_id": "lyr_1", "name": "press", "points": 900, "still_seen": 0, "looked_through": 890}],
}
"""Of when a walk was an excuse, and a layer was looked through as a whole."""


@pytest.fixture
def placed(admin: httpx.Client, by_hand: ByHand) -> str:
    """Return the id of a placement on a map with a ready revision."""
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    return a_placement(admin, by_hand, map_id)


def rewrite(by_hand: ByHand, row: type[Any], key: str, columns: Mapping[str, Any]) -> None:
    """Put into a row what an earlier version had written."""
    with by_hand.kernel.db.writing("record-placement") as session:
        found = session.get_one(row, key)
        for name, value in columns.items():
            setattr(found, name, value)


@pytest.mark.parametrize("kept", [FIRST_EVIDENCE, WALKS_EXCUSED, {}, {"iterations": "many", "starts": [1]}])
def test_evidence_of_any_version_is_shown_member_by_member(
    kept: dict[str, Any], placed: str, admin: httpx.Client, by_hand: ByHand
) -> None:
    rewrite(by_hand, Placement, placed, {"evidence": kept, "initial_pose": None, "candidates": None})
    shown = ok(admin.get(f"/v1/placements/{placed}"))
    evidence, names = shown["evidence"], PlacementEvidence.__dataclass_fields__
    assert set(evidence) | {"gone", "earlier"} == set(names)
    unreadable = {"iterations", "starts"} if kept.get("iterations") == "many" else set()
    for name in names.keys() - {"gone", "earlier"}:
        assert evidence[name] == (None if name in unreadable else kept.get(name)), name
    gone = kept.keys() - names
    assert evidence.get("earlier", {}) == {name: kept[name] for name in gone}
    if "gone" in kept:
        counts = {"points": 900, "still_seen": 0, "looked_through": 890}
        assert evidence["gone"] == [
            {
                "layer_id": "lyr_1",
                "name": "press",
                "whole_layer": True,
                "things": [{"region": None, **counts}],
            }
        ]


def test_candidates_and_poses_of_any_version_are_shown(
    placed: str, admin: httpx.Client, by_hand: ByHand
) -> None:
    told = {"candidates": [{"T_map_scan": IDENTITY}, {"starts": 2}], "initial_pose": {"x_m": 1, "y_m": 2}}
    rewrite(by_hand, Placement, placed, told)
    shown = ok(admin.get(f"/v1/placements/{placed}"))
    lacking = {"inlier_share": None, "inlier_share_of_structure": None}
    assert shown["candidates"] == [
        {"T_map_scan": IDENTITY, "starts": None, **lacking},
        {"T_map_scan": None, "starts": 2, **lacking},
    ]
    assert shown["initial_pose"] == {"x_m": 1.0, "y_m": 2.0, "z_m": 0.0, "yaw_rad": 0.0}


def test_revisions_of_any_version_are_shown(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    n = a_ready_revision(admin, by_hand, map_id)
    where = f"/v1/maps/{map_id}/revisions/{n}"
    with by_hand.kernel.db.reading() as session:
        (key,) = (row.id for row in session.query(Revision).filter_by(map_id=map_id))
    first = {"voxel_size_m": 0.2, "wall_height_m": 3.0, "floor": True, "ceiling": False}
    rewrite(by_hand, Revision, key, {"recipe": first, "operations": None, "erased": None})
    shown = ok(admin.get(where))
    assert shown["recipe"] == Recipe(voxel_size_m=0.2, wall_height_m=3.0, floor=True).to_json()
    assert (shown["operations"], shown["erased"]) == (None, None)
    step = {"op": "add-layer", "layer_id": "lyr_1", "placement_id": "plc_1", "name": "press"}
    rewrite(by_hand, Revision, key, {"operations": [step, {"op": "set-recipe", "recipe": first}]})
    assert ok(admin.get(where))["operations"] == [step, {"op": "set-recipe", "recipe": first}]


def test_proposals_of_any_version_are_shown(placed: str, admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = ok(admin.get(f"/v1/placements/{placed}"))["map_id"]
    with by_hand.kernel.db.writing("record-placement") as session:
        row = Proposal(
            id="prp_1", map_id=map_id, placement_id=placed, layer_id="lyr_1", state="open",
            evidence=WALKS_EXCUSED["gone"][0], created_at=by_hand.kernel.now(),
        )  # fmt: skip
        session.add(row)
    (shown,) = ok(admin.get(f"/v1/maps/{map_id}/proposals"))["items"]
    assert shown["evidence"]["whole_layer"] is True
    assert shown["evidence"]["things"][0]["looked_through"] == 890


SCALE_IN_PIXELS = {"state": "given", "metres_per_px": 0.02, "evidence": {"known_length": {"length_m": 9.0}}}
FIRST_FINDING = {"code": "no-walls", "severity": "serious", "message": "Nothing looks like a wall."}
PLAIN = {**FIRST_FINDING, "values": {}, "where": None}
RING = [[0.0, 0.0], [90.0, 0.0], [90.0, 40.0]]


@pytest.mark.parametrize(
    ("kept", "shown"),
    [
        (FIRST_FINDING, PLAIN),
        ({**FIRST_FINDING, "layers": ["A", "B"]}, {**PLAIN, "values": {"layers": ["A", "B"]}}),
        (
            {**FIRST_FINDING, "witness": {"kind": "extent", "metres_per_unit": [1.0, 2.0], "count": 3}},
            {
                **PLAIN,
                "values": {
                    "witness_kind": "extent",
                    "witness_metres_per_unit": [1.0, 2.0],
                    "witness_count": 3,
                },
            },
        ),
        (
            {**FIRST_FINDING, "plans": [{"within": RING}]},
            {**PLAIN, "where": {"type": "MultiPolygon", "coordinates": [[[*RING, RING[0]]]]}},
        ),
        ({**FIRST_FINDING, "plans": 2}, {**PLAIN, "values": {"plans": 2}}),
        ({**FIRST_FINDING, "deep": [{"a": 1}]}, {**PLAIN, "values": {"deep": '[{"a": 1}]'}}),
        ({"message": "Old."}, {**PLAIN, "code": None, "severity": None, "message": "Old."}),
        ({**PLAIN, "values": {"tilt_rad": 0.1, "up": "y", "on": True}}, None),
    ],
)
def test_findings_of_any_version_are_shown(
    kept: dict[str, Any], shown: dict[str, Any] | None, placed: str, admin: httpx.Client, by_hand: ByHand
) -> None:
    scan_id = ok(admin.get(f"/v1/placements/{placed}"))["scan_id"]
    rewrite(by_hand, Scan, scan_id, {"reading": {"points": 3, "findings": [kept]}})
    reading = ok(admin.get(f"/v1/scans/{scan_id}"))["reading"]
    assert reading["findings"] == [kept if shown is None else shown]
    assert (reading["points"], reading["scan_frame"], reading["extent_m"]) == (3, None, None)


def test_readings_of_drawings_of_any_version_are_shown(admin: httpx.Client, by_hand: ByHand) -> None:
    drawing_id = by_hand.drawing(a_map(admin))
    first = {
        "frame": "drawing", "unit": "m", "scale": SCALE_IN_PIXELS, "sheet": [20.0, 10.0],
        "drawing_origin": [0.0, 0.0], "style": "outlined",
        "counts": {"walls": 4, "columns": 0, "wall_length_m": 60.0, "removed": {"text": 2}},
        "findings": [],
    }  # fmt: skip
    rewrite(by_hand, Drawing, drawing_id, {"reading": first, "options": {}})
    reading = ok(admin.get(f"/v1/drawings/{drawing_id}"))["reading"]
    assert reading["scale"] == {"state": "given", "metres_per_unit": 0.02}
    assert reading["counts"] == {**first["counts"], "removed_strokes": None}
    assert (reading["confidence"], reading["layers"], reading["drawing_top"]) == (None, None, None)
    for odd in ({"scale": {"state": "unknown"}}, {"scale": "1:100", "findings": "none"}, {}):
        rewrite(by_hand, Drawing, drawing_id, {"reading": odd})
        assert ok(admin.get(f"/v1/drawings/{drawing_id}"))["reading"]["findings"] is None


def test_reasons_of_any_version_are_shown(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    a_ready_revision(admin, by_hand, map_id)
    placement_id = a_placement(admin, by_hand, map_id, verdict="needs-review")
    doubt, other = "The scan had to be tilted by 9.1 degrees.", "One doubt of a version long gone."
    told = [
        {"code": "tilted", "values": {}, "where": None, "detail": doubt},
        {"code": "unspecified", "values": {}, "where": None, "detail": other},
    ]
    rewrite(by_hand, Placement, placement_id, {"reasons": [doubt, other]})
    assert ok(admin.get(f"/v1/placements/{placement_id}"))["reasons"] == told
    assert refused(admin.post(f"/v1/placements/{placement_id}/accept"), 409, SLUG)["reasons"] == told
    made = ok(admin.post(f"/v1/placements/{placement_id}/accept", json={"reviewed": True}), 202)
    by_hand.build(made["job"]["id"])
    (gate,) = ok(admin.get(f"/v1/maps/{map_id}/revisions/2/gates"))["gates"]
    assert gate["message"].endswith(f"'needs-review': {doubt}")
    assert gate["reasons"] == told
    override = {"override": {"reason": "seen"}}
    ok(admin.post(f"/v1/maps/{map_id}/revisions/2/publish", json=override))
    (move,) = ok(admin.get(f"/v1/maps/{map_id}/publications"))["items"]
    assert move["overridden"] == [gate]
    rewrite(
        by_hand,
        Publication,
        move["id"],
        {"overridden": [{k: gate[k] for k in ("code", "subject", "message")}]},
    )
    (move,) = ok(admin.get(f"/v1/maps/{map_id}/publications"))["items"]
    assert move["overridden"] == [{**gate, "reasons": []}]


FIRST_REPORT = {
    "frame": "map",
    "inputs": {
        "drawing": {"id": "drw_1", "sha256": "a" * 64, "walls_sha256": "b" * 64},
        "scale": SCALE_IN_PIXELS,
        "layers": [{"name": "press", "scan_id": "scn_1"}],
    },
    "recipe": {"voxel_size_m": 0.2},
    "counts": {"points": 9, "points_by_label": {"wall": 9}, "walls": 4, "columns": 0, "wall_length_m": 60.0},
    "layers": [{"name": "press", "points_given": 4000}],
    "extent_m": {"min": [0.0, 0.0, 0.0], "max": [20.0, 10.0, 2.5]},
    "findings": [{**FIRST_FINDING, "files": ["octree.json"]}],
}


def test_reports_of_any_version_are_shown(admin: httpx.Client, by_hand: ByHand) -> None:
    map_id = a_map(admin)
    where = f"/v1/maps/{map_id}/revisions/{a_ready_revision(admin, by_hand, map_id)}"
    with by_hand.kernel.db.reading() as session:
        (key,) = (row.id for row in session.query(Revision).filter_by(map_id=map_id))
    rewrite(by_hand, Revision, key, {"report": FIRST_REPORT, "drawing_frame": None})
    report = ok(admin.get(where))["report"]
    assert report["counts"] == FIRST_REPORT["counts"]
    assert report["extent_m"] == FIRST_REPORT["extent_m"]
    assert (report["drawing_origin"], report["T_map_drawing"]) == (None, None)
    assert report["inputs"]["drawing"] == FIRST_REPORT["inputs"]["drawing"]  # type: ignore[index]
    assert report["inputs"]["scale"] == {"state": "given", "metres_per_unit": 0.02}
    assert report["inputs"]["layers"][0]["scan_id"] == "scn_1"
    (layer,) = report["layers"]
    unknown = BuiltLayer.__dataclass_fields__.keys() - {"name", "points_given"}
    assert layer == {"name": "press", "points_given": 4000, **dict.fromkeys(unknown)}
    assert report["findings"] == [{**PLAIN, "values": {"files": ["octree.json"]}}]
    for odd in ({"points": 1}, {"layers": 3, "inputs": []}, {}):
        rewrite(by_hand, Revision, key, {"report": odd})
        assert set(ok(admin.get(where))["report"].values()) == {None}
