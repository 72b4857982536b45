"""A revision's report, as the worker writes it: how each layer was judged, and who took it in."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import select

from service.db.models import Artifact, Drawing, Key, Placement, Revision, Scan
from service.domain.access import Actor
from service.domain.lifecycle import JobState, Role
from service.usecases.accept_placement import accept_placement
from service.usecases.revise import Wanted, revise
from tests.worker.workbench import Workbench, a_small_drawing, a_small_scan

pytestmark = pytest.mark.slow


def test_the_report_tells_evidence_verdict_and_who_accepted(bench: Workbench, tmp_path: Path) -> None:
    admin = Actor(bench.key_id, Role.ADMIN)
    with bench.kernel.db.writing("receive-drawing") as session:
        key = Key(id="key_tablet", name="t", role="tablet", digest="t", created_at=bench.kernel.now())
        session.add(key)
    with bench.worker():
        read = bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        assert bench.wait_final(read).state == JobState.SUCCEEDED
        with bench.kernel.db.writing("revise") as session:
            drawing = session.scalars(select(Drawing)).one()
            wanted = Wanted(drawing_id=drawing.id, recipe={"voxel_size_m": 0.1})
            build = revise(bench.kernel, session, admin, map_id=bench.map_id, wanted=wanted).job.id
        assert bench.wait_final(build).state == JobState.SUCCEEDED
        scan = bench.add_scan(a_small_scan(tmp_path / "scan.pcd"))
        assert bench.wait_final(scan).state == JobState.SUCCEEDED
        place = bench.wait_final(bench.add_placement(scan, revision_n=1))
        assert place.state == JobState.SUCCEEDED, place.problem
        tablet = replace(admin, key_id="key_tablet", role=Role.TABLET)
        with bench.kernel.db.writing("accept-placement") as session:
            session.get_one(
                Placement, place.subject_id
            ).verdict = "needs-review"  # so small a room is rejected
            taken = accept_placement(
                bench.kernel, session, tablet, placement_id=place.subject_id, reviewed=True, name="room"
            )
            build, layer_id = taken.job.id, taken.shown.layers[0].layer_id
        assert bench.wait_final(build).state == JobState.SUCCEEDED
        with bench.kernel.db.writing("revise") as session:
            wanted = Wanted(base=2, recipe={"floor": True})
            build = revise(bench.kernel, session, admin, map_id=bench.map_id, wanted=wanted).job.id
        assert bench.wait_final(build).state == JobState.SUCCEEDED
        again = bench.wait_final(bench.add_rebuild(3))
        assert again.state == JobState.SUCCEEDED, again.problem
    with bench.kernel.db.reading() as session:
        placement = session.get_one(Placement, place.subject_id)
        second, third = session.scalars(select(Revision).where(Revision.n > 1).order_by(Revision.n)).all()
        reading = session.scalars(select(Drawing)).one().reading
        file = session.get_one(Artifact, (third.id, "report.json"))
        assert session.scalars(select(Scan)).one().id == placement.scan_id
    report = json.loads(bench.kernel.blobs.path(file.sha256).read_text(encoding="utf-8"))
    assert report == third.report
    assert placement.evidence is not None
    assert reading is not None
    (layer,) = report["layers"]
    assert (layer["layer_id"], layer["placement_id"], layer["name"]) == (layer_id, placement.id, "room")
    assert (layer["verdict"], layer["reasons"]) == (placement.verdict, placement.reasons)
    assert layer["evidence"] == placement.evidence
    assert layer["covariance"] == placement.evidence["covariance"]
    assert (layer["accepted_by"], layer["accepted_at"]) == ("key_tablet", second.created_at.isoformat())
    assert third.created_by == bench.key_id
    assert report["drawing_origin"] == reading["drawing_origin"]
    assert report["T_map_drawing"][0][3] == -reading["drawing_origin"][0]
    assert report["T_map_drawing"][1][3] == reading["drawing_top"]
