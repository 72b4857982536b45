"""How many bytes a change costs a robot: a hall of 120 x 80 m in which ten of 150 objects were moved."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from service.domain.recipe import Recipe
from worker.formats.artifacts import write_artifacts
from worker.formats.delta import write_delta
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall

pytestmark = pytest.mark.benchmark

LENGTH, WIDTH, HEIGHT = 120.0, 80.0, 2.5
OBJECTS, MOVED = 150, 10
VOXEL = 0.05


def hall() -> list[Wall]:
    """Return the outer walls and bays along both long sides."""
    lines = [[(0, 0), (LENGTH, 0)], [(LENGTH, 0), (LENGTH, WIDTH)], [(LENGTH, WIDTH), (0, WIDTH)]]
    lines += [[(0, WIDTH), (0, 0)]]
    lines += [[(x, y), (x, y + 9.0)] for x in np.arange(10.0, 120.0, 10.0) for y in (0.1, WIDTH - 9.1)]
    return [Wall.of(np.array(line, dtype=float), thickness=0.2) for line in lines]


def scanned_box(rng: np.random.Generator) -> np.ndarray:
    """Return a tablet's points on the four sides and the top of a machine, at its own origin."""
    size = rng.uniform([1.0, 1.0, 0.8], [2.5, 2.2, 2.0])
    dense = 1600  # points a square metre
    sides = []
    for axis in range(3):
        for end in (0.0, size[axis]) if axis < 2 else (size[2],):
            area = float(np.prod(np.delete(size, axis)))
            points = rng.uniform(0, size, (int(dense * area), 3))
            points[:, axis] = end
            sides.append(points)
    points = np.vstack(sides) + rng.normal(0, 0.003, (sum(map(len, sides)), 3))
    yaw = rng.uniform(0, np.pi)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return np.asarray((points - [size[0] / 2, size[1] / 2, 0]) @ turn.T)


def build(directory: Path, boxes: list[np.ndarray], at: np.ndarray) -> Path:
    directory.mkdir()
    layers = [
        PlacedLayer(f"object {k}", PointCloud.of(box + np.array([*at[k], 0.0])))
        for k, box in enumerate(boxes)
    ]
    recipe = Recipe(voxel_size_m=VOXEL, wall_height_m=HEIGHT, layer_voxel_size_m=VOXEL)
    write_artifacts(directory, walls=hall(), recipe=recipe, layers=layers, inputs={})
    return directory


@pytest.mark.parametrize("seed", range(5))
def test_a_delta_is_a_few_percent(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    boxes = [scanned_box(rng) for _ in range(OBJECTS)]
    at = rng.uniform([4, 4], [LENGTH - 4, WIDTH - 4], (OBJECTS, 2))
    before = build(tmp_path / "before", boxes, at)
    chosen = rng.choice(OBJECTS, MOVED, replace=False)
    direction = rng.uniform(0, 2 * np.pi, MOVED)
    at[chosen] += rng.uniform(0.5, 3.0, (MOVED, 1)) * np.column_stack([np.cos(direction), np.sin(direction)])
    after = build(tmp_path / "after", boxes, at)
    old, new, delta = before / "point-cloud.pcd", after / "point-cloud.pcd", tmp_path / "delta.zst"
    begun = time.perf_counter()
    write_delta(delta, old=old, new=new)
    took = time.perf_counter() - begun
    subprocess.run(
        ["zstd", "-dqf", "--long=31", f"--patch-from={old}", delta, "-o", tmp_path / "out.pcd"], check=True
    )
    assert (tmp_path / "out.pcd").read_bytes() == new.read_bytes()

    full = new.stat().st_size
    counts = json.loads((after / "report.json").read_text())["counts"]
    share = counts["points_by_label"]["layer"] / counts["points"]
    kept = {path.name for path in (before / "tiles").iterdir()}
    tiles = list((after / "tiles").iterdir())
    changed = [path for path in tiles if path.name not in kept]
    changed_bytes = sum(path.stat().st_size for path in changed)
    coded = (after / "point-cloud.pcd.zst").stat().st_size
    print(
        f"\nseed {seed}: {counts['points']} points, {share:.0%} in objects; full {full / 1e6:.2f} MB, "
        f"zstd {coded / full:.1%}, changed tiles {len(changed)}/{len(tiles)} "
        f"= {len(changed) / len(tiles):.0%} "
        f"({changed_bytes / full:.1%} of the bytes), delta {delta.stat().st_size / full:.2%} in {took:.1f} s"
    )
    assert share >= 0.3
    assert delta.stat().st_size <= 0.03 * full
    assert len(changed) <= 0.45 * len(tiles)
