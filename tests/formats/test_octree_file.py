"""The octree's files: read as a viewer reads them, they give the whole cloud."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from worker.formats.octree import write_octree
from worker.geometry.cloud.point_cloud import PointCloud


def test_all_nodes_together_are_the_cloud(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    lattice = np.stack(np.meshgrid(np.arange(400), np.arange(200), [0, 1], indexing="ij"), axis=-1)
    points = 0.15 * lattice.reshape(-1, 3) + rng.uniform(-0.05, 0.05, (160_000, 3)) + (-20.0, 5.0, 0.0)
    cloud = PointCloud(points, rng.integers(0, 5, len(points)).astype(np.uint32))
    binary, description = write_octree(tmp_path, cloud)
    told = json.loads(description.read_text())
    records = np.fromfile(binary, dtype="<u2").reshape(-1, 4)
    assert len(records) == told["points"] == sum(node[4] for node in told["nodes"]) == len(points)
    assert len(told["nodes"]) > 8
    depth, x, y, z = (
        np.repeat([n[k] for n in told["nodes"]], [n[4] for n in told["nodes"]]) for k in range(4)
    )
    edges = told["edge_m"] / 2.0**depth
    read = np.array(told["low_m"]) + (np.column_stack([x, y, z]) + records[:, :3] / 65_535) * edges[:, None]
    apart, nearest = cKDTree(points).query(read)
    assert apart.max() < 0.5 * told["edge_m"] / 65_535 * np.sqrt(3.0) * 1.001
    np.testing.assert_array_equal(np.sort(nearest), np.arange(len(points)))
    np.testing.assert_array_equal(records[:, 3], cloud.labels[nearest])
    np.testing.assert_allclose(told["extent_m"]["max"], points.max(axis=0))
