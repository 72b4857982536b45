"""The story: an admin builds a map, a tablet adds a machine, a robot fetches the map and checks it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from demo import steps
from demo.client import Client
from demo.console import Console, expect
from demo.hall import WALL_HEIGHT, Hall, Machine
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, rough_pose, scan_of_new_machine
from worker.formats.pcd import read_pcd

_RECIPE = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}
_MAX_ERROR_M, _MAX_ERROR_DEG = 0.10, 1.0
_MACHINE_POINTS = 200
_LOOKED_AT = "The person at the tablet looked at the placement: it fits."
_EVIDENCE = ("euclidean_fitness_score_m2", "transformation_probability", "inlier_share", "residual_median_m")


@dataclass(frozen=True)
class Story:
    """Hold what all acts share.

    Parameters
    ----------
    hall : Hall
        The truth.
    admin : Client
        The first admin's door.
    folder : Path
        Where files are laid down for people to look at.
    console : Console
        Where it is told.
    """

    hall: Hall
    admin: Client
    folder: Path
    console: Console

    def play(self) -> Path:
        """Play all acts and return the path of the last preview picture.

        Raises
        ------
        DemoFailed
            At the first step that does not hold.
        """
        map_id = self._make_the_map()
        tablet, robot = (steps.make_key(self.admin, role, map_id) for role in ("tablet", "robot"))
        before, etag = self._fetch(robot, map_id, 1, known_etag=None)
        self._add_the_machine(tablet, map_id)
        self.console.act("Admin: publish what the tablet added")
        preview = self._publish(map_id, 2)
        after, _ = self._fetch(robot, map_id, 2, known_etag=etag)
        self._compare(before, after)
        return preview

    def _make_the_map(self) -> str:
        self.console.act("Admin: a map from the design drawing")
        map_id = steps.make_map(self.admin, site="demonstration works", name="ground floor")
        self.console.say(f"map {map_id} created")
        content, clicked = drawing_png(self.hall), known_length(self.hall)
        path = self.folder / "drawing.png"
        path.write_bytes(content)
        self.console.say(f"drawing with dimension lines, numbers and a title block: {path}")
        drawing = steps.read_drawing(self.admin, map_id, content, clicked=clicked)
        self.console.say(f"uploaded {len(content)} bytes with a known length of {clicked.length_m:.2f} m")
        self.console.say(f"read: {_numbers(drawing['reading']['counts'])}")
        set_aside = _numbers(drawing["reading"]["counts"]["removed"])
        self.console.say(f"strokes set aside, each with its reason: {set_aside}")
        n = steps.build_revision(self.admin, map_id, drawing_id=drawing["id"], recipe=_RECIPE)
        expect(n == 1, f"the first revision has number {n}")
        self._publish(map_id, 1)
        return map_id

    def _publish(self, map_id: str, n: int) -> Path:
        """Show a revision's files, save its preview picture, publish it; return the picture's path."""
        files = steps.artifacts(self.admin, map_id, n)
        sizes = ", ".join(f"{name} {file['size_bytes']}" for name, file in files.items())
        self.console.say(f"revision {n} is ready; bytes: {sizes}")
        path = self.folder / f"preview-revision-{n}.png"
        where = f"/v1/maps/{map_id}/revisions/{n}/artifacts/preview.png"
        path.write_bytes(self.admin.request("GET", where, expected=(200,)).content)
        self.console.say(f"its preview picture: {path}")
        gates = steps.gates(self.admin, map_id, n)
        for gate in gates:
            self.console.say(f"a gate is closed: {gate}")
        steps.publish(self.admin, map_id, n, override=_LOOKED_AT if gates else None)
        if gates:
            self.console.say(f"the admin publishes it all the same, and says why: {_LOOKED_AT}")
        self.console.say(f"revision {n} published on channel stable")
        return path

    def _add_the_machine(self, tablet: Client, map_id: str) -> None:
        self.console.act("Tablet: a scan of the new machine")
        scan = scan_of_new_machine(self.hall, seed=self.hall.seed)
        content = ply_bytes(scan.cloud.points)
        path = self.folder / "scan.ply"
        path.write_bytes(content)
        on_machine = int((scan.object_ids == self.hall.scene.id_of(self.hall.new_machine.name)).sum())
        self.console.say(f"simulated scan: {len(scan.cloud)} points, {on_machine} on the machine: {path}")
        uploaded = steps.read_scan(tablet, map_id, content)
        self.console.say(f"uploaded {len(content)} bytes; read: {_numbers(uploaded['reading'])}")
        rough = rough_pose(scan.T_map_scan, seed=self.hall.seed)
        off, turned = rough.distance_to(scan.T_map_scan)
        self.console.say(f"rough pose from a person: {off:.3f} m and {math.degrees(turned):.2f} degrees off")
        placement = steps.place_scan(tablet, uploaded["id"], revision=1, rough=rough)
        off, turned = steps.pose_of(placement).distance_to(scan.T_map_scan)
        verdict = placement["verdict"]
        self.console.say(f"placed, against the truth: {off:.4f} m and {math.degrees(turned):.3f} degrees off")
        evidence = {name: placement["evidence"][name] for name in _EVIDENCE}
        self.console.say(f"verdict: {verdict}; {_numbers(evidence)}")
        for reason in placement["reasons"]:
            self.console.say(f"  {reason['detail']}")
        expect(verdict != "rejected", f"the verdict is {verdict}: {placement['reasons']}")
        expect(
            off <= _MAX_ERROR_M and math.degrees(turned) <= _MAX_ERROR_DEG,
            f"{verdict}, but more than {_MAX_ERROR_M} m or {_MAX_ERROR_DEG} degree off the truth",
        )
        if verdict == "needs-review":
            self.console.say("the person looks at it on the map, sees that it fits, and says so")
        n = steps.accept(tablet, placement["id"], reviewed=verdict == "needs-review")
        expect(n == 2, f"accepting made revision {n}, not 2")
        self.console.say("confirmed by the person at the tablet: revision 2 is built")

    def _fetch(
        self,
        robot: Client,
        map_id: str,
        n: int,
        *,
        known_etag: str | None,
    ) -> tuple[Path, str]:
        """Return where the robot laid the published point cloud, and the pointer's ETag."""
        self.console.act("Robot: which map should I have?")
        told, etag = steps.poll(robot, map_id, known_etag=known_etag)
        expect(told == n, f"the robot was told revision {told}, not {n}")
        again, _ = steps.poll(robot, map_id, known_etag=etag)
        expect(again is None, "the pointer was sent again though it had not moved")
        self.console.say(f"told: revision {n}; asked again with the ETag: 304, nothing new")
        to = self.folder / f"point-cloud-revision-{n}.pcd"
        got = steps.download(robot, map_id, n, name="point-cloud.pcd", to=to)
        self.console.say(f"point-cloud.pcd: {got.size} bytes, cut after {got.cut_at} and resumed by Range")
        self.console.say(f"SHA-256 {got.sha256} = ETag = artifact list; asked again: 304")
        return to, etag

    def _compare(self, before: Path, after: Path) -> None:
        old, new = (_points_on(self.hall.new_machine, path) for path in (before, after))
        self.console.say(f"points on the new machine: {old} in revision 1, {new} in revision 2")
        expect(old == 0, f"revision 1 has {old} points where the new machine stands; the drawing lacks it")
        expect(new >= _MACHINE_POINTS, f"revision 2 has only {new} points on the new machine")


def _points_on(machine: Machine, path: Path) -> int:
    return int(machine.holds(read_pcd(path).points, margin=0.05).sum())


def _numbers(document: dict[str, Any]) -> str:
    """Return the plain numbers of a JSON document in one line."""
    plain = {k: v for k, v in document.items() if isinstance(v, int | float) and not isinstance(v, bool)}
    return ", ".join(f"{name} {value:.5g}" for name, value in plain.items())
