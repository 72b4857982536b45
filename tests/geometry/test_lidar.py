"""Scenes, ray casting and the simulated tablet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from service.domain.transform import Transform
from tests.factories import wall_prism
from worker.geometry.lidar.ray_casting import MISS, cast_rays
from worker.geometry.lidar.scene import Scene, box, cylinder, prism, slab, turned_box
from worker.geometry.lidar.tablet import TabletPath, TabletSensor, scan_with_tablet


def _areas(scene: Scene) -> NDArray[np.float64]:
    a, b, c = (scene.vertices[scene.triangles[:, k]] for k in range(3))
    areas: NDArray[np.float64] = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return areas


def _volume(scene: Scene) -> float:
    """Return the enclosed volume by the divergence theorem: its sign says which way the faces look."""
    a, b, c = (scene.vertices[scene.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def _room() -> Scene:
    return Scene.of(
        slab((0, 0), (6, 5), z=0.0, name="floor"),
        wall_prism((0, -0.1), (6, -0.1), thickness=0.2, z_low=0, z_high=3, name="wall"),
        wall_prism((0, 5.1), (6, 5.1), thickness=0.2, z_low=0, z_high=3, name="wall"),
        wall_prism((-0.1, 0), (-0.1, 5), thickness=0.2, z_low=0, z_high=3, name="wall"),
        wall_prism((6.1, 0), (6.1, 5), thickness=0.2, z_low=0, z_high=3, name="wall"),
        box((4, 3, 0), (5, 4.5, 1.6), name="machine"),
    )


def _distance_to_scene(points: NDArray[np.float64], scene: Scene) -> NDArray[np.float64]:
    """Return how far each point lies from the nearest triangle, by closed form (Ericson, section 5.1.5)."""
    best = np.full(len(points), np.inf)
    for triangle in scene.triangles:
        a, b, c = scene.vertices[triangle]
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        height = (points - a) @ normal
        foot = points - height[:, None] * normal
        inside = np.ones(len(points), dtype=bool)
        for start, end in ((a, b), (b, c), (c, a)):
            inside &= np.cross(end - start, foot - start) @ normal >= 0
            along = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
            best = np.minimum(best, np.linalg.norm(points - start - along[:, None] * (end - start), axis=1))
        best = np.where(inside, np.minimum(best, np.abs(height)), best)
    return best


def test_a_prism_encloses_its_volume_with_faces_that_look_outward() -> None:
    triangle = prism([(0, 0), (4, 0), (0, 3)], 1.0, 3.0, name="wedge")
    assert _volume(triangle) == pytest.approx(12.0)
    assert _areas(triangle).sum() == pytest.approx(2 * 6 + 12 * 2)


def test_boxes_and_walls_have_their_closed_form_volume_and_surface() -> None:
    turned = turned_box((5, 5, 0), (2, 1, 3), yaw=0.7, name="b")
    wall = wall_prism((1, 1), (4, 5), thickness=0.2, z_low=0, z_high=2.5, name="w")
    for scene, volume, area in ((turned, 6.0, 2 * (2 + 6 + 3)), (wall, 2.5, 2 * (1 + 12.5 + 0.5))):
        assert _volume(scene) == pytest.approx(volume)
        assert _areas(scene).sum() == pytest.approx(area)


def test_a_cylinder_approaches_its_volume_as_sides_grow() -> None:
    ideal = np.pi * 0.5**2 * 2.0
    errors = [
        abs(_volume(cylinder((1, 2, 0), 0.5, height=2, name="c", sides=n)) - ideal) for n in (8, 16, 32)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)


def test_parts_of_one_name_are_one_object_and_ids_survive_joining() -> None:
    room = _room()
    assert room.names == ("floor", "wall", "machine")
    assert np.bincount(room.object_ids).tolist() == [2, 48, 12]
    machine = room.only("machine")
    assert set(machine.object_ids.tolist()) == {room.id_of("machine")}
    assert machine.vertices[machine.triangles].reshape(-1, 3).min(axis=0).tolist() == [4, 3, 0]


def test_scenes_that_contradict_themselves_are_refused() -> None:
    good = box((0, 0, 0), (1, 1, 1), name="b")
    with pytest.raises(ValueError, match="points outside"):
        Scene(good.vertices, good.triangles + 1, good.object_ids, good.names)
    with pytest.raises(ValueError, match="as many object ids"):
        Scene(good.vertices, good.triangles, good.object_ids[1:], good.names)
    with pytest.raises(ValueError, match="above its bottom"):
        box((0, 0, 1), (1, 1, 1), name="flat")
    with pytest.raises(ValueError, match="same point"):
        wall_prism((1, 1), (1, 1), thickness=0.2, z_low=0, z_high=1, name="w")


@settings(max_examples=40, deadline=None)
@given(
    origin=st.tuples(*[st.floats(-0.95, 0.95)] * 3),
    direction=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1),
)
def test_rays_inside_a_box_meet_the_nearest_slab(
    origin: tuple[float, float, float], direction: tuple[float, float, float]
) -> None:
    o, d = np.array([origin]), np.array([direction])
    hits = cast_rays(box((-1, -1, -1), (1, 1, 1), name="b"), o, d)
    unit = (d / np.linalg.norm(d))[0]
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        expected = np.min(np.where(unit != 0, (np.sign(unit) - o[0]) / unit, np.inf))
    assert hits.distances[0] == pytest.approx(expected, abs=1e-5)
    assert np.allclose(hits.points[0], o[0] + expected * unit, atol=1e-5)


def test_a_ray_meets_the_first_of_two_objects_and_a_stray_one_misses() -> None:
    scene = Scene.of(box((2, -1, -1), (3, 1, 1), name="near"), box((5, -1, -1), (6, 1, 1), name="far"))
    origins = np.array([(0.0, 0, 0), (4.0, 0, 0), (10.0, 0, 0), (0.0, 0, 0)])
    directions = np.array([(7.0, 0, 0), (1.0, 0, 0), (-1.0, 0, 0), (0.0, 0, 1.0)])
    hits = cast_rays(scene, origins, directions)
    assert hits.object_ids.tolist() == [0, 1, 1, MISS]
    assert hits.distances == pytest.approx([2, 1, 4, np.inf], abs=1e-5)
    assert np.isinf(hits.points[3]).all()


def test_precision_holds_a_kilometre_from_the_origin() -> None:
    near = cast_rays(_room(), np.array([(1.0, 1.0, 1.0)]), np.array([(1.0, 0.3, 0.1)]))
    offset = np.array((1000.0, -2000.0, 30.0))
    far = cast_rays(_room().moved(offset), np.array([(1.0, 1.0, 1.0)]) + offset, np.array([(1.0, 0.3, 0.1)]))
    assert far.distances[0] == pytest.approx(near.distances[0], abs=1e-5)
    assert np.allclose(far.points - offset, near.points, atol=1e-5)


def test_an_empty_scene_is_missed_and_a_ray_without_direction_is_a_defect() -> None:
    ray = np.array([(0.0, 0.0, 0.0)])
    assert cast_rays(Scene.of(), ray, ray + 1).object_ids.tolist() == [MISS]
    with pytest.raises(ValueError, match="have a direction"):
        cast_rays(_room(), ray, ray)


@pytest.mark.parametrize("seed", [1, 7])
def test_the_truth_puts_scan_points_on_the_surfaces_within_noise(seed: int) -> None:
    room = _room()
    path = TabletPath.turning((2.0, 2.0), start_yaw=0.9, frames=16)
    scan = scan_with_tablet(room, path, seed=seed, sensor=TabletSensor(noise=0.01))
    in_map = scan.T_map_scan.apply(scan.cloud.points)
    for name in room.names:
        mine = scan.object_ids == room.id_of(name)
        assert mine.sum() > 200
        off = _distance_to_scene(in_map[mine], room.only(name))
        assert np.sqrt((off**2).mean()) < 0.01
        assert off.max() < 0.055


def test_without_noise_the_points_lie_on_the_surfaces_exactly() -> None:
    path = TabletPath.walking([(1, 1), (3, 1), (3, 3)], look_at=(4.5, 3.7), frames=8)
    scan = scan_with_tablet(_room(), path, seed=3, sensor=TabletSensor(noise=0.0))
    assert _distance_to_scene(scan.T_map_scan.apply(scan.cloud.points), _room()).max() < 1e-5


def test_the_scan_frame_is_where_and_whither_the_tablet_first_looked_levelled() -> None:
    path = TabletPath.turning((2.0, 2.0), start_yaw=2.5, frames=12, height=1.5)
    truth = scan_with_tablet(_room(), path, seed=5).T_map_scan
    roll, pitch, yaw = truth.rpy
    assert (roll, pitch) == (0, 0)
    assert yaw == pytest.approx(2.5, abs=np.deg2rad(2))
    assert truth.translation == pytest.approx([2.0, 2.0, 1.5], abs=0.05)


def test_nothing_beyond_the_range_is_recorded_and_detail_leaves_one_point_a_cube() -> None:
    sensor = TabletSensor(max_range=2.5, noise=0.0, detail=0.05)
    path = TabletPath.turning((3.0, 2.5), start_yaw=0.0, frames=12)
    scan = scan_with_tablet(_room(), path, seed=2, sensor=sensor)
    assert np.linalg.norm(scan.cloud.points, axis=1).max() < 2.5 + 0.1
    cubes = np.floor(scan.T_map_scan.apply(scan.cloud.points) / 0.05 + 1e-9).astype(int)
    assert len(np.unique(cubes, axis=0)) > 0.99 * len(cubes)


def test_the_same_seed_gives_the_same_scan_and_another_seed_another() -> None:
    path = TabletPath.turning((2.0, 2.0), start_yaw=0.0, frames=6)
    first, again, other = (scan_with_tablet(_room(), path, seed=s) for s in (11, 11, 12))
    assert np.array_equal(first.cloud.points, again.cloud.points)
    assert np.array_equal(first.T_map_scan.matrix, again.T_map_scan.matrix)
    assert not np.array_equal(first.T_map_scan.matrix, other.T_map_scan.matrix)


def test_moving_the_world_moves_the_truth_and_not_the_scan() -> None:
    path = TabletPath.turning((2.0, 2.0), start_yaw=0.4, frames=6)
    offset = np.array((10.0, -3.0, 0.0))
    moved = TabletPath(path.positions + offset, path.yaws, path.pitches)
    sensor = TabletSensor(detail=1e-4)
    here = scan_with_tablet(_room(), path, seed=4, sensor=sensor)
    there = scan_with_tablet(_room().moved(offset), moved, seed=4, sensor=sensor)
    shift = Transform.from_xyz_yaw(*offset, 0.0)
    assert (shift @ here.T_map_scan).distance_to(there.T_map_scan)[0] < 1e-9
    assert len(here.cloud) == pytest.approx(len(there.cloud), rel=0.001)
    assert np.abs(np.median(here.cloud.points, axis=0) - np.median(there.cloud.points, axis=0)).max() < 1e-3


def test_a_tablet_in_the_desert_is_told_so() -> None:
    far_away = TabletPath.turning((100.0, 100.0), start_yaw=0.0, frames=2)
    with pytest.raises(ValueError, match="nothing lies within"):
        scan_with_tablet(_room(), far_away, seed=0)
