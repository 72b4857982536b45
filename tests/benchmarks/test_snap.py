"""The answer to a dragged pose over HTTP: service and worker on SQLite, a scan of a few 100,000 points."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np
import pytest

from demo import steps
from demo.client import Client
from demo.hall import WALL_HEIGHT, synthetic_hall
from demo.running import groundplan_up
from demo.sheet import drawing_png, known_length
from demo.survey import ply_bytes, scan_of_new_machine
from service.domain.transform import Transform

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(600)]

SEED, ROUNDS = 7, 15
DRAGGED_M, TURNED_RAD = 2.0, np.deg2rad(20.0)
RECIPE = {"voxel_size_m": 0.1, "wall_height_m": WALL_HEIGHT, "floor": True}


def test_a_dragged_scan_snaps(tmp_path: Path) -> None:
    hall, rng = synthetic_hall(SEED), np.random.default_rng(SEED)
    scan = scan_of_new_machine(hall, seed=SEED)
    x, y, z = scan.T_map_scan.translation
    with groundplan_up(tmp_path) as running:
        admin = Client(running.address, running.admin_key)
        map_id = steps.make_map(admin, site="Nagoya", name="Hall 3")
        drawing = steps.read_drawing(admin, map_id, drawing_png(hall), clicked=known_length(hall))
        n = steps.build_revision(admin, map_id, drawing_id=drawing["id"], recipe=RECIPE)
        read = steps.read_scan(admin, map_id, ply_bytes(scan.cloud.points))
        took = []
        for _ in range(ROUNDS):
            dx, dy = rng.uniform(-DRAGGED_M, DRAGGED_M, 2) / np.sqrt(2.0)
            yaw = scan.T_map_scan.rpy[2] + rng.uniform(-TURNED_RAD, TURNED_RAD)
            began = time.perf_counter()
            placed = steps.place_scan(
                admin, read["id"], revision=n, rough=Transform.from_xyz_yaw(x + dx, y + dy, z, yaw)
            )
            took.append(time.perf_counter() - began)
            assert steps.pose_of(placed).distance_to(scan.T_map_scan)[0] < 0.1
    print(
        f"\nsnap over HTTP, {len(scan.cloud.points):,} points, {ROUNDS} times: median "
        f"{statistics.median(took):.2f} s, {min(took):.2f} to {max(took):.2f} s (goal: under a second)"
    )
