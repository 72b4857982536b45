"""A full warehouse on a map of its walls alone: placed, split, merged, and what a LiDAR gains by that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from service.domain.acceptance import judge
from service.domain.layer_part import TARGET
from service.domain.recipe import Recipe
from service.domain.transform import Transform
from tests.benchmarks.buildings import rough
from tests.benchmarks.vlp16 import free_points, load_world, position_errors, scan, starts_off
from worker.geometry.cloud.merge import PlacedLayer, compound
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.drawing.reading.reading import Wall
from worker.geometry.lidar.scene import Scene
from worker.geometry.lidar.tablet import TabletPath, TabletScan, scan_with_tablet
from worker.geometry.registration.ndt_map import build_ndt_map
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.target import PlacementTarget

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(3600)]

WALLS, GROUND = "WallB", "Ground"
STOPS, POINTS, RESOLUTION = 9, 40, 1.0
RECIPE = Recipe(voxel_size_m=0.1, floor=True)


def walls_of(world: Scene) -> tuple[Wall, ...]:
    """Return the four walls of the rectangle that the wall object is, each as thick as it is there."""
    walls = [k for k, name in enumerate(world.names) if WALLS in name]
    corners = world.vertices[np.unique(world.triangles[np.isin(world.object_ids, walls)])][:, :2]
    outer = np.abs(corners).max(axis=0)
    inner = np.array([np.abs(corners[:, k])[np.abs(corners[:, k]) > 0.5 * outer[k]].min() for k in (0, 1)])
    x, y = (outer + inner) / 2
    ring = np.array([(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)])
    thick = outer - inner
    return tuple(Wall.of(ring[k : k + 2], thickness=float(thick[1 - k % 2])) for k in range(4))


def a_tour(world: Scene, seed: int) -> TabletScan:
    """Return a scan from nine free places along the hall."""
    rng = np.random.default_rng(seed)
    half = np.abs(world.vertices[:, :2]).max(axis=0) - 1.0
    path = None
    for low in np.linspace(-half[1], half[1], STOPS + 1)[:-1]:
        among = rng.uniform((-half[0], low), (half[0], low + 2.0 * half[1] / STOPS), (400, 2))
        x, y, _ = free_points(world, among, count=1, clearance=0.5)[0]
        turn = TabletPath.turning((x, y), start_yaw=float(rng.uniform(-np.pi, np.pi)))
        path = turn if path is None else path.then(turn)
    assert path is not None
    return scan_with_tablet(world, path, seed=seed)


def test_a_full_warehouse_is_placed_and_helps_a_lidar(shared_data: Path) -> None:
    world = load_world(shared_data / "worlds" / "aws_small_warehouse_noroof.npz", (0.0, 0.0))
    walls = walls_of(world)
    target = PlacementTarget.from_faces(walls, wall_height=RECIPE.wall_height_m)
    taken = a_tour(world, 1)
    cloud = PointCloud.of(taken.cloud.points)
    anywhere = place_scan(cloud, target, initial=None)
    print(f"\nno pose: {judge(anywhere.evidence).verdict}; candidates, off from the truth:")
    for candidate in anywhere.candidates:
        off, turned = candidate.T_map_scan.distance_to(taken.T_map_scan)
        print(f"  {off:.3f} m {np.rad2deg(turned):.1f} degrees")
    near = rough(taken.T_map_scan, np.random.default_rng(3), metres=3.0, degrees=45.0)
    placed = place_scan(cloud, target, initial=near)
    off, turned = placed.T_map_scan.distance_to(taken.T_map_scan)
    print(f"rough pose: {judge(placed.evidence).verdict}, {off:.3f} m, {np.rad2deg(turned):.2f} degrees off")
    building = [k for k, name in enumerate(world.names) if WALLS in name or GROUND in name]
    truth, found = ~np.isin(taken.object_ids, building), placed.labels == TARGET
    print(f"target: F1 {2 * np.sum(truth & found) / (np.sum(truth) + np.sum(found)):.3f}")
    _print_gain(world, walls, PointCloud.of(placed.T_map_scan.apply(cloud.points[found]), Label.LAYER))


def _print_gain(world: Scene, walls: tuple[Wall, ...], layer: PointCloud) -> None:
    rng = np.random.default_rng(20)
    half = np.abs(walls[0].centre).max(axis=0) - 0.5
    positions = free_points(world, rng.uniform(-half, half, (4000, 2)), count=POINTS, clearance=0.35)
    scans = [scan(world, position, every=4, rng=rng) for position in positions]
    starts: list[Transform] = starts_off(positions, rng)
    errors = {}
    for name, layers in (("before", ()), ("after", (PlacedLayer("scan", layer),))):
        merged = compound(walls, recipe=RECIPE, layers=layers).points
        on_plan, _ = position_errors(build_ndt_map(merged, RESOLUTION), scans, starts, positions).T
        errors[name] = on_plan
        print(
            f"{name:>6}: {len(merged)} points, mean position error of a VLP-16 at {POINTS} points "
            f"{on_plan.mean():.3f} m (median {np.median(on_plan):.3f}), "
            f"within 0.1 m {(on_plan <= 0.1).mean():.0%}"
        )
    assert errors["after"].mean() < errors["before"].mean()
