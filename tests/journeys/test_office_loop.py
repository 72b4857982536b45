"""The whole loop on a real drawing, with a tablet simulated in the building that was made from it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from demo import steps
from demo.client import Client
from demo.running import groundplan_up
from demo.sheet import KnownLength
from demo.survey import ply_bytes, rough_pose
from worker.formats.pcd import read_pcd
from worker.geometry.cloud.point_cloud import Label
from worker.geometry.lidar.scene import Scene, turned_box
from worker.geometry.lidar.tablet import TabletPath, TabletScan, scan_with_tablet

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
DRAWING = DATA / "drawings" / "rmf_office.png"
WORLD = DATA / "worlds" / "rmf_office.npz"
DRAWING_FROM_WORLD = (0.0, 14.5353, 0.0)
WALL_HEIGHT = 2.5

pytestmark = pytest.mark.skipif(
    not DRAWING.exists(), reason=f"{DATA} is absent: it is no part of the project"
)


@dataclass(frozen=True)
class Case:
    """Hold where a box is put and where the person with the tablet stands, in the drawing's frame [m]."""

    name: str
    box: tuple[float, float]
    size: tuple[float, float, float]
    yaw: float
    stands: tuple[tuple[float, float], ...]
    seed: int

    def holds(self, points: NDArray[np.float64]) -> int:
        """Return how many points lie on the box, 5 cm around it and clear of the floor."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = (points[:, :2] - self.box) @ np.array([(c, -s), (s, c)])
        length, width, height = self.size
        inside = (np.abs(local[:, 0]) < length / 2 + 0.05) & (np.abs(local[:, 1]) < width / 2 + 0.05)
        return int((inside & (points[:, 2] > 0.15) & (points[:, 2] < height + 0.05)).sum())


CASES = (
    Case("left room", (4.6, 6.4), (1.2, 0.8, 1.5), 0.4, ((5.2, 8.6), (5.6, 5.4)), 1),
    Case("open plan", (13.0, 6.4), (1.6, 0.9, 1.2), -0.3, ((11.6, 5.4), (14.4, 7.4)), 2),
    Case("lower right room", (21.3, 6.6), (0.9, 0.9, 1.8), 0.8, ((20.4, 7.6), (21.0, 4.9)), 3),
)


def office_scan(case: Case) -> TabletScan:
    """Return what a tablet sees of the office with the box in it; the truth is in the drawing's frame."""
    world = np.load(WORLD)
    names = tuple(f"world {name}" for name in world["names"])
    office = Scene(
        world["v"].astype(float), world["f"].astype(np.int64), world["fid"].astype(np.int64), names
    )
    box = turned_box((*case.box, 0.0), case.size, yaw=case.yaw, name="box")
    scene = Scene.of(office.moved(DRAWING_FROM_WORLD), box)
    path = None
    for number, stand in enumerate(case.stands):
        to_box = math.atan2(case.box[1] - stand[1], case.box[0] - stand[0])
        turning = TabletPath.turning(stand, start_yaw=to_box + 0.3 * number, frames=48)
        path = turning if path is None else path.then(turning)
    assert path is not None
    return scan_with_tablet(scene, path, seed=case.seed)


def office_length() -> KnownLength:
    """Return the length that a person would measure in the office drawing."""
    truth = json.loads(DRAWING.with_suffix(".truth.json").read_text(encoding="utf-8"))
    return KnownLength(*truth["known_length_px"])


def play(admin: Client, case: Case, folder: Path) -> dict[str, float | str]:
    """Play the loop for one case on a map of its own and return what came out."""
    map_id = steps.make_map(admin, site="office", name=case.name)
    tablet, robot = (steps.make_key(admin, role, map_id) for role in ("tablet", "robot"))
    drawing = steps.read_drawing(tablet, map_id, DRAWING.read_bytes(), clicked=office_length())
    recipe = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}
    assert steps.build_revision(admin, map_id, drawing_id=drawing["id"], recipe=recipe) == 1
    scan = office_scan(case)
    uploaded = steps.read_scan(tablet, map_id, ply_bytes(scan.cloud.points))
    rough = rough_pose(scan.T_map_scan, seed=case.seed)
    placement = steps.place_scan(tablet, uploaded["id"], revision=1, rough=rough)
    off, turned = steps.pose_of(placement).distance_to(scan.T_map_scan)
    outcome: dict[str, float | str] = {
        "verdict": placement["verdict"],
        "reasons": str(placement["reasons"]),
        "error_m": off,
        "error_deg": math.degrees(turned),
    }
    if placement["verdict"] != "accepted":
        return outcome
    assert steps.accept(tablet, placement["id"]) == 2
    for n in (1, 2):
        steps.publish(admin, map_id, n)
        got = steps.download(robot, map_id, n, name="point-cloud.pcd", to=folder / f"revision-{n}.pcd")
        cloud = read_pcd(got.path)
        outcome[f"box_points_{n}"] = case.holds(cloud.points)
        outcome[f"layer_points_{n}"] = int((cloud.labels == Label.LAYER).sum())
    return outcome


@pytest.fixture(scope="module")
def admin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    with groundplan_up(tmp_path_factory.mktemp("office")) as running:
        yield Client(running.address, running.admin_key)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_box_in_the_office_reaches_revision_2(admin: Client, case: Case, tmp_path: Path) -> None:
    outcome = play(admin, case, tmp_path)
    assert outcome["verdict"] == "accepted", outcome
    assert float(outcome["error_m"]) < 0.1, outcome
    assert float(outcome["error_deg"]) < 1.0, outcome
    assert outcome["box_points_1"] == 0, outcome
    assert float(outcome["box_points_2"]) > 200, outcome
    assert outcome["layer_points_1"] == 0, outcome
