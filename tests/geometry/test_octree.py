"""Levels of detail: every point in one node and in its cube, coarse nodes spread, whatever the cloud."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from worker.geometry.cloud.octree import Octree, octree

Points = NDArray[np.float64]


def a_wall(*, spacing: float, length: float) -> Points:
    along, up = np.meshgrid(np.arange(0.0, length, spacing), np.arange(0.0, 3.0, spacing))
    return np.column_stack([along.ravel(), np.zeros(along.size), up.ravel()])


def clouds() -> dict[str, Points]:
    rng = np.random.default_rng(5)
    return {
        "one point": np.array([[3.0, -2.0, 1.0]]),
        "twins": np.tile([[1.0, 2.0, 3.0]], (30_000, 1)),
        "wall": a_wall(spacing=0.02, length=40.0),
        "scattered": rng.uniform(-300.0, 300.0, (60_000, 3)),
        "far and near": np.vstack([rng.normal(0.0, 0.01, (50_000, 3)), [[500.0, 500.0, 20.0]]]),
    }


def cube(tree: Octree, number: int) -> tuple[Points, float]:
    node = tree.nodes[number]
    edge = tree.edge / 2**node.depth
    return tree.low + np.array(node.cell) * edge, edge


@pytest.mark.parametrize("name", clouds())
def test_every_point_is_in_one_node_and_in_its_cube(name: str) -> None:
    points = clouds()[name]
    tree = octree(points)
    np.testing.assert_array_equal(np.sort(tree.order), np.arange(len(points)))
    assert [node.begin for node in tree.nodes] == [
        sum(n.count for n in tree.nodes[:k]) for k in range(len(tree.nodes))
    ]
    assert sum(node.count for node in tree.nodes) == len(points)
    assert [node.depth for node in tree.nodes] == sorted(node.depth for node in tree.nodes)
    assert len({(node.depth, node.cell) for node in tree.nodes}) == len(tree.nodes)
    for number, node in enumerate(tree.nodes):
        low, edge = cube(tree, number)
        held = points[tree.order[node.begin : node.begin + node.count]]
        assert (held >= low - 1e-9 * tree.edge).all()
        assert (held <= low + edge * (1 + 1e-9)).all()


def test_a_node_s_sample_is_spread_over_its_cube() -> None:
    points = a_wall(spacing=0.02, length=40.0)
    tree = octree(points)
    assert tree.nodes[0].depth == 0
    root = points[tree.order[: tree.nodes[0].count]]
    every, sample = (
        np.unique(np.minimum((p - tree.low) * 64 // tree.edge, 63), axis=0) for p in (points, root)
    )
    assert len(sample) == len(root)
    np.testing.assert_array_equal(sample, every)


def test_a_node_below_has_a_node_above() -> None:
    tree = octree(clouds()["wall"])
    known = {(node.depth, node.cell) for node in tree.nodes}
    for node in tree.nodes:
        x, y, z = node.cell
        assert node.depth == 0 or (node.depth - 1, (x // 2, y // 2, z // 2)) in known


def test_no_node_of_a_surface_is_large() -> None:
    points = a_wall(spacing=0.01, length=80.0)
    assert max(node.count for node in octree(points).nodes) <= 12_000 < len(points)
