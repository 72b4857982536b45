"""The paper's section 4 rebuilt: one room placed from a lattice of starts, by us and by our peers.

``GROUNDPLAN_STARTS`` is how many of the lattice's 3,280 starts are tried (40 unless set, picked evenly at
random; all of them with ``all``), and how many of the wide set (at most 200); ``GROUNDPLAN_PICTURES`` is a
folder for pictures like the paper's figures 8 and 9. Peers that are not installed are left out and named:
``uv sync --group peers`` brings small_gicp, Debian's libpcl-dev and g++ bring PCL.
"""

from __future__ import annotations

import importlib
import itertools
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.errors import PlacementNotComputed
from service.domain.recipe import Recipe
from service.domain.transform import Transform
from tests.benchmarks.buildings import a_building, a_scan, rough
from tests.benchmarks.ndt_against_pcl.peer import NoPcl, ask, compile_peer
from worker.formats.pcd import write_pcd
from worker.geometry.cloud.merge import compound
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.cloud.voxel_grid import voxel_grid_filter
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.target import PlacementTarget

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(36_000)]

RIGHT_M, RIGHT_RAD = 0.1, np.deg2rad(1.0)
LEVEL = [round(0.1 * k, 1) for k in range(-9, 10)]
HEIGHTS = [0.0, 0.1, -0.1, 0.3, -0.3, 0.5, -0.5, 0.9, -0.9]
TURNS = list(range(-15, 16))
MOST_WIDE = 200
PEER_STEP, NDT_CELL, ICP_REACH = 0.1, 1.0, 1.0
BUILDING, SCAN = 3, 11

Offset = tuple[float, float, float, float]
Found = list[tuple[NDArray[np.float64] | None, float]]


@dataclass(frozen=True, eq=False)
class Room:
    """Hold a tablet scan of one room of a building, object left in, its true pose, and maps as clouds."""

    scan: PointCloud
    truth: Transform
    faces: PlacementTarget
    clouds: dict[float, NDArray[np.float64]]


def a_room() -> Room:
    """Return a room with floor and ceiling, and the drawing's map of it at 0.1 and 0.4 m."""
    building = a_building(BUILDING, deviation=0.0)
    taken = a_scan(building, SCAN)
    clouds = {}
    for voxel in (0.1, 0.4):
        recipe = Recipe(voxel_size_m=voxel, wall_height_m=building.height, floor=True, ceiling=True)
        clouds[voxel] = compound(building.drawn, recipe=recipe).points
    faces = PlacementTarget.from_faces(building.drawn, wall_height=building.height, ceiling=True)
    return Room(PointCloud.of(taken.cloud.points), taken.T_map_scan, faces, clouds)


def lattice() -> list[Offset]:
    """Return the paper's starts: dx, dy, dz [m] and turn [degrees] from the truth."""
    moved = [(dx, dy, dz, 0.0) for dz, dy, dx in itertools.product(HEIGHTS, LEVEL, LEVEL)]
    return moved + [(0.0, 0.0, 0.0, float(turn)) for turn in TURNS]


def start_at(truth: Transform, offset: Offset) -> Transform:
    """Return the pose that far from the truth, turned about the scan's origin."""
    dx, dy, dz, turn = offset
    x, y, z = truth.translation
    return Transform.from_xyz_yaw(x + dx, y + dy, z + dz, truth.rpy[2] + np.deg2rad(turn))


def ours(room: Room, target: PlacementTarget, starts: Sequence[Transform]) -> Found:
    """Return where our placement ends, and its seconds."""
    out: Found = []
    for start in starts:
        begin = time.perf_counter()
        try:
            pose = place_scan(room.scan, target, initial=start).T_map_scan.matrix
        except PlacementNotComputed:
            pose = None
        out.append((pose, time.perf_counter() - begin))
    return out


def by_pcl(program: Path, folder: Path, method: str, reach: float) -> Callable[..., Found]:
    """Return PCL's NDT or ICP."""

    def run(source: NDArray[np.float64], cloud: NDArray[np.float64], starts: Sequence[Transform]) -> Found:
        write_pcd(folder / "source.pcd", PointCloud.of(source))
        write_pcd(folder / "target.pcd", PointCloud.of(cloud))
        np.savetxt(folder / "starts.txt", [start.matrix.ravel() for start in starts])
        answer = ask(
            program, "starts", method, folder / "source.pcd", folder / "target.pcd", reach, 1e-6,
            folder / "starts.txt",
        )  # fmt: skip
        poses = np.array(answer["poses"]).reshape(-1, 4, 4)
        return list(zip(poses, answer["seconds"], strict=True))

    return run


def by_small_gicp(kind: str) -> Callable[..., Found]:
    """Return small_gicp's GICP or VGICP, its preparation done once."""
    small_gicp: Any = importlib.import_module("small_gicp")

    def run(source: NDArray[np.float64], cloud: NDArray[np.float64], starts: Sequence[Transform]) -> Found:
        target, tree = small_gicp.preprocess_points(cloud, PEER_STEP, num_threads=1)
        moving, _ = small_gicp.preprocess_points(source, PEER_STEP, num_threads=1)
        out: Found = []
        for start in starts:
            begin = time.perf_counter()
            if kind == "VGICP":
                voxels = small_gicp.GaussianVoxelMap(NDT_CELL)
                voxels.insert(target)
                result = small_gicp.align(voxels, moving, start.matrix, num_threads=1)
            else:
                result = small_gicp.align(
                    target, moving, tree, start.matrix, registration_type=kind, num_threads=1,
                    max_correspondence_distance=ICP_REACH,
                )  # fmt: skip
            out.append((np.array(result.T_target_source), time.perf_counter() - begin))
        return out

    return run


def by_open3d(kind: str) -> Callable[..., Found]:
    """Return Open3D's point-to-plane ICP or its NDT."""
    import open3d as o3d  # noqa: PLC0415 - slow to load, and only here

    registration: Any = o3d.pipelines.registration

    def cloud_of(points: NDArray[np.float64]) -> Any:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(1.0, 20))
        return cloud

    def run(source: NDArray[np.float64], cloud: NDArray[np.float64], starts: Sequence[Transform]) -> Found:
        moving, target = cloud_of(source), cloud_of(cloud)
        plane = registration.TransformationEstimationPointToPlane()
        out: Found = []
        for start in starts:
            begin = time.perf_counter()
            if kind == "ICP":
                result = registration.registration_icp(
                    moving, target, ICP_REACH, start.matrix, plane,
                    registration.ICPConvergenceCriteria(max_iteration=100),
                )  # fmt: skip
            else:
                result = registration.registration_ndt(moving, target, init=start.matrix)
            out.append((np.array(result.transformation), time.perf_counter() - begin))
        return out

    return run


def peers(folder: Path) -> dict[str, Callable[..., Found]]:
    """Return the peers that are here, by name; those that are not are printed."""
    found: dict[str, Callable[..., Found]] = {}
    try:
        program = compile_peer(folder)
        found |= {
            "PCL NDT": by_pcl(program, folder, "ndt", NDT_CELL),
            "PCL ICP": by_pcl(program, folder, "icp", ICP_REACH),
        }
    except NoPcl as missing:
        print(missing)
    try:
        found |= {f"small_gicp {kind}": by_small_gicp(kind) for kind in ("GICP", "VGICP")}
    except ModuleNotFoundError:
        print("small_gicp is not installed: uv sync --group peers")
    return found | {f"Open3D {kind}": by_open3d(kind) for kind in ("ICP", "NDT")}


def is_right(pose: NDArray[np.float64] | None, truth: Transform) -> bool:
    """Return whether a pose is within 0.1 m and 1 degree of the truth."""
    if pose is None or not np.isfinite(pose).all():
        return False
    turned = pose[:3, :3].T @ truth.rotation
    angle = np.arccos(np.clip((np.trace(turned) - 1.0) / 2.0, -1.0, 1.0))
    return bool(np.linalg.norm(pose[:3, 3] - truth.translation) < RIGHT_M and angle < RIGHT_RAD)


def picked() -> tuple[list[Offset], int]:
    """Return the starts of the lattice that are tried, and the number of wide ones."""
    every, said = lattice(), os.environ.get("GROUNDPLAN_STARTS", "40")
    if said == "all":
        return every, MOST_WIDE
    few = np.random.default_rng(4).choice(len(every), min(int(said), len(every)), replace=False)
    return [every[k] for k in np.sort(few)], min(int(said), MOST_WIDE)


def draw(path: Path, tried: Sequence[Offset], right: Sequence[bool]) -> None:
    """Draw the lattice as the paper's figures: a panel a height, a row of turns; disc right, cross wrong."""
    cell, gap = 16, 40
    side = cell * len(LEVEL) + gap
    image = np.full((2 * side + side, 5 * side, 3), 255, np.uint8)
    for (dx, dy, dz, turn), good in zip(tried, right, strict=True):
        if turn:
            x, y = gap + cell * (int(turn) + 15), 2 * side + gap
        else:
            panel = HEIGHTS.index(dz)
            x = (panel % 5) * side + gap + cell * LEVEL.index(dx)
            y = (panel // 5) * side + side - cell * LEVEL.index(dy) - cell
        if good:
            cv2.circle(image, (x, y), 5, (60, 120, 0), -1, cv2.LINE_AA)
        else:
            cv2.drawMarker(image, (x, y), (30, 30, 220), cv2.MARKER_TILTED_CROSS, 9, 2)
    for panel, dz in enumerate(HEIGHTS):
        at = ((panel % 5) * side + gap, (panel // 5) * side + 24)
        cv2.putText(image, f"dz {dz:+.1f} m", at, cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    words = "turn -15 to 15 degrees"
    cv2.putText(image, words, (gap, 2 * side + 24), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    cv2.imwrite(str(path), image[: 2 * side + 3 * gap])


def test_the_papers_lattice_and_a_wide_set_of_starts(tmp_path: Path) -> None:
    room = a_room()
    tried, wide_count = picked()
    rng = np.random.default_rng(9)
    sets = {
        "lattice": [start_at(room.truth, offset) for offset in tried],
        "wide": [rough(room.truth, rng, metres=3.0, degrees=45.0) for _ in range(wide_count)],
    }
    targets = {"faces": room.faces} | {
        f"cloud {voxel} m": PlacementTarget.from_cloud(cloud) for voxel, cloud in room.clouds.items()
    }
    runs: list[tuple[str, str, Callable[[Sequence[Transform]], Found]]] = [
        ("Groundplan", map_name, lambda starts, t=target: ours(room, t, starts))  # type: ignore[misc]
        for map_name, target in targets.items()
    ]
    thin = voxel_grid_filter(room.scan.points, PEER_STEP)
    for name, peer in peers(tmp_path).items():
        runs += [
            (name, f"cloud {voxel} m", lambda starts, p=peer, c=cloud: p(thin, c, starts))  # type: ignore[misc]
            for voxel, cloud in room.clouds.items()
        ]
    print(
        f"\n{len(tried)} starts of the lattice of {len(lattice())}, {wide_count} within 3 m and 45 degrees;"
    )
    print(
        f"our scan has {len(room.scan)} points, the peers' is thinned to {len(thin)} before the clock starts"
    )
    pictures = os.environ.get("GROUNDPLAN_PICTURES")
    ours_right = []
    for name, map_name, run in runs:
        line = f"{name:>17} on {map_name:<11}"
        for set_name, starts in sets.items():
            found = run(starts)
            right = [is_right(pose, room.truth) for pose, _ in found]
            line += (
                f"  {set_name} {np.mean(right):6.1%}, {statistics.median(s for _, s in found) * 1e3:7.0f} ms"
            )
            if set_name == "lattice" and pictures:
                draw(Path(pictures) / f"{name} {map_name}.png".replace(" ", "-"), tried, right)
            if name == "Groundplan" and map_name == "faces":
                ours_right += right
        print(line, flush=True)
    assert all(ours_right)
