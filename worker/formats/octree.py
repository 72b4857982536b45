"""A map's cloud for viewers: ``octree.json`` tells the nodes, ``octree.bin`` has their points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from worker.formats.reading import write_json
from worker.geometry.cloud.octree import octree
from worker.geometry.cloud.point_cloud import PointCloud

_STEPS = 65_535


def write_octree(directory: Path, cloud: PointCloud) -> list[Path]:
    """Write both files and return their paths.

    Parameters
    ----------
    directory : Path
        Exists; files of the same names are overwritten.
    cloud : PointCloud
        In frame `map`, one point or more.

    Notes
    -----
    A point is four little-endian uint16: x, y and z within its node's cube, 65,535 for the whole edge, and
    its label; a browser hands them to the graphics card as they are. They lie within half a step of the
    cloud's: 0.5 mm in a map of 64 m.
    """
    tree = octree(cloud.points)
    records = np.zeros((len(cloud), 4), dtype="<u2")
    nodes = []
    for node in tree.nodes:
        edge = tree.edge / (1 << node.depth)
        part = slice(node.begin, node.begin + node.count)
        taken = tree.order[part]
        within = (cloud.points[taken] - (tree.low + np.array(node.cell) * edge)) / edge
        records[part, :3] = np.rint(np.clip(within, 0.0, 1.0) * _STEPS)
        records[part, 3] = cloud.labels[taken]
        nodes.append([node.depth, *node.cell, node.count])
    binary, description = directory / "octree.bin", directory / "octree.json"
    binary.write_bytes(records.tobytes())
    summary = {
        "format": "groundplan-octree/1",
        "frame": "map",
        "points": len(cloud),
        "low_m": tree.low.tolist(),
        "edge_m": tree.edge,
        "extent_m": {"min": cloud.points.min(axis=0).tolist(), "max": cloud.points.max(axis=0).tolist()},
        "nodes": nodes,
    }
    write_json(description, summary)
    return [binary, description]
