"""A hall through its changes: scans placed, moved, replaced, removed; compared, published, rebuilt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from demo import steps
from demo.client import Client
from demo.hall import WALL_HEIGHT, Hall, synthetic_hall
from demo.running import groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, rough_pose
from tests.worker.conftest import DATABASES
from worker.formats.pcd import read_pcd
from worker.geometry.cloud.point_cloud import Label
from worker.geometry.lidar.scene import Scene, turned_box
from worker.geometry.lidar.tablet import TabletPath, scan_with_tablet

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Box:
    """Hold a thing in the office of the hall: where it stands [m] and how it is turned [rad]."""

    x: float
    y: float
    yaw: float
    size: tuple[float, float, float] = (1.0, 0.7, 1.3)

    def scene(self, name: str) -> Scene:
        """Return it as triangles."""
        return turned_box((self.x, self.y, 0.0), self.size, yaw=self.yaw, name=name)

    def on(self, points: NDArray[np.float64]) -> int:
        """Return how many points lie on it, 6 cm around it and clear of the floor."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = (points[:, :2] - (self.x, self.y)) @ np.array([(c, -s), (s, c)])
        half = np.array(self.size[:2]) / 2 + 0.06
        inside = (np.abs(local) < half).all(axis=1)
        return int((inside & (points[:, 2] > 0.15) & (points[:, 2] < self.size[2] + 0.06)).sum())


@dataclass
class Site:
    """Hold one hall's map on one installation, and what is done to it."""

    admin: Client
    hall: Hall
    map_id: str
    folder: Path
    scans: int = 0

    def placed(self, stand: tuple[float, float], *boxes: Box, on: int) -> dict[str, Any]:
        """Return the placement of a scan of the office with these boxes in it."""
        self.scans += 1
        scene = Scene.of(self.hall.scene, *(box.scene(f"box {k}") for k, box in enumerate(boxes)))
        path = TabletPath.turning(stand, start_yaw=0.4 * self.scans, frames=48)
        scan = scan_with_tablet(scene, path, seed=self.scans)
        uploaded = steps.read_scan(self.admin, self.map_id, ply_bytes(scan.cloud.points))
        rough = rough_pose(scan.T_map_scan, seed=self.scans)
        placement = steps.place_scan(self.admin, uploaded["id"], revision=on, rough=rough)
        off, _ = steps.pose_of(placement).distance_to(scan.T_map_scan)
        assert placement["verdict"] == "accepted", placement["reasons"]
        assert off < 0.1, placement
        return placement

    def accepted(self, placement: dict[str, Any], name: str) -> dict[str, Any]:
        """Return the revision that a placement made, ready."""
        answer = self.admin.post(f"/v1/placements/{placement['id']}/accept", {"name": name})
        self.admin.done(answer["job"])
        return self.revision(answer["revision"]["n"])

    def revised(self, base: int, *operations: dict[str, Any]) -> dict[str, Any]:
        """Return the revision that operations on a base made, ready."""
        body = {"base": base, "operations": list(operations), "reason": "the layout changed"}
        answer = self.admin.post(f"/v1/maps/{self.map_id}/revisions", body)
        self.admin.done(answer["job"])
        return self.revision(answer["revision"]["n"])

    def revision(self, n: int) -> dict[str, Any]:
        """Return a revision."""
        return self.admin.get(f"/v1/maps/{self.map_id}/revisions/{n}")

    def layer_points(self, n: int) -> NDArray[np.float64]:
        """Return the points of a revision that come from layers."""
        where = f"/v1/maps/{self.map_id}/revisions/{n}/artifacts/point-cloud.pcd"
        path = self.folder / f"revision-{n}.pcd"
        path.write_bytes(self.admin.request("GET", where, expected=(200,)).content)
        cloud = read_pcd(path)
        return cloud.points[cloud.labels == Label.LAYER]

    def compared(self, n: int, with_n: int) -> dict[str, Any]:
        """Return a comparison, made."""
        where = f"/v1/maps/{self.map_id}/revisions/{n}/compare?with={with_n}"
        asked = self.admin.request("GET", where, expected=(200, 202)).json()
        self.admin.done(asked["job"])
        return self.admin.get(where)

    def published(self, n: int, channel: str) -> None:
        """Point a channel to a revision."""
        where = f"/v1/maps/{self.map_id}/revisions/{n}/publish"
        assert self.admin.post(where, {"channel": channel})["revision"] == n

    def told(self, channel: str) -> int:
        """Return what a robot on a channel is told."""
        n: int = self.admin.get(f"/v1/maps/{self.map_id}/published?channel={channel}")["revision"]
        return n


@pytest.fixture(params=DATABASES)
def site(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    if request.param != "sqlite":
        monkeypatch.setenv("GROUNDPLAN_DATABASE_URL", request.getfixturevalue("empty_postgres_url"))
    hall = synthetic_hall(3)
    with groundplan_up(tmp_path) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="works", name="ground floor")
        yield Site(admin, hall, map_id, tmp_path)


def test_a_layout_changes_and_every_state_of_it_can_be_had_again(site: Site) -> None:
    office = site.hall.rooms[1].floor
    (x, y), admin = office.centre, site.admin
    a, b = Box(office.x0 + 1.8, office.y0 + 1.8, 0.3), Box(office.x1 - 1.8, office.y1 - 2.0, -0.4)
    c, c_later = Box(office.x1 - 1.6, office.y0 + 2.0, 0.1), Box(office.x0 + 1.6, office.y1 - 2.2, 0.9)
    drawing = steps.read_drawing(admin, site.map_id, drawing_png(site.hall), clicked=known_length(site.hall))
    recipe = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True, "ceiling": True}
    assert steps.build_revision(admin, site.map_id, drawing_id=drawing["id"], recipe=recipe) == 1

    placements = [
        site.placed(stand, box, on=1)
        for stand, box in (((x - 0.5, y), a), ((x + 0.5, y - 0.4), b), ((x, y + 0.5), c))
    ]
    three = [site.accepted(p, name) for p, name in zip(placements, "abc", strict=True)][-1]
    assert (three["n"], [layer["name"] for layer in three["layers"]]) == (4, ["a", "b", "c"])
    points = site.layer_points(4)
    assert min(box.on(points) for box in (a, b, c)) > 200

    ids = {layer["name"]: layer["layer_id"] for layer in three["layers"]}
    moved = site.revised(4, {"op": "move-layer", "layer_id": ids["b"], "by": {"x_m": -1.5}})
    points = site.layer_points(moved["n"])
    assert b.on(points) < 20
    assert Box(b.x - 1.5, b.y, b.yaw).on(points) > 200

    anew = site.placed((x - 0.3, y + 0.3), c_later, on=moved["n"])
    gone = {one["layer_id"] for one in admin.get(f"/v1/maps/{site.map_id}/proposals?state=open")["items"]}
    assert {ids["a"], ids["c"]} <= gone, "the scan looked through what stood there before"
    replace = {"op": "replace-layer", "layer_id": ids["c"], "placement_id": anew["id"]}
    replaced = site.revised(moved["n"], replace)
    points = site.layer_points(replaced["n"])
    assert c.on(points) < 20
    assert c_later.on(points) > 200

    removed = site.revised(replaced["n"], {"op": "remove-layer", "layer_id": ids["a"]})
    points = site.layer_points(removed["n"])
    assert a.on(points) < 20
    assert [layer["layer_id"] for layer in removed["layers"]] == [ids["b"], ids["c"]]

    told = site.compared(removed["n"], with_n=4)
    assert {(d["subject"], d["change"]) for d in told["differences"] if d["subject"].startswith("layer")} == {
        (f"layer.{ids['a']}", "removed"),
        (f"layer.{ids['b']}", "moved"),
        (f"layer.{ids['c']}", "replaced"),
    }
    before, after = (site.layer_points(n) for n in (4, removed["n"]))
    assert told["geometry"]["points_added"] - told["geometry"]["points_removed"] == len(after) - len(before)
    picture = admin.request("GET", told["picture_url"].removeprefix(admin.address), expected=(200,))
    assert picture.content.startswith(b"\x89PNG")

    left = admin.get(f"/v1/maps/{site.map_id}/proposals?state=open")["items"]
    assert {one["layer_id"] for one in left} <= {ids["b"]}, "what was proposed of a and c was done"
    site.published(removed["n"], "canary")
    site.published(4, "stable")
    site.published(removed["n"], "stable")
    assert (site.told("canary"), site.told("stable")) == (removed["n"], removed["n"])
    site.published(4, "stable")
    assert (site.told("canary"), site.told("stable")) == (removed["n"], 4)
    moves = admin.get(f"/v1/maps/{site.map_id}/publications?channel=stable")["items"]
    assert [m["rolled_back"] for m in moves] == [True, False, False]

    for n in range(1, removed["n"] + 1):
        job = admin.done(admin.post(f"/v1/maps/{site.map_id}/revisions/{n}/rebuild"))
        assert job["state"] == "succeeded", "the same inputs give the same bytes"
    again = site.revised(removed["n"], {"op": "set-recipe", "recipe": {"floor": True}})
    assert again["artifacts_sha256"] is not None
    digests = [steps.artifacts(admin, site.map_id, n)["point-cloud.pcd"]["sha256"]
               for n in (removed["n"], again["n"])]  # fmt: skip
    assert digests[0] == digests[1]
