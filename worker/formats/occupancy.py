"""Occupancy grids as ROS `map_server` (Nav2) reads them: a PGM picture and a YAML description."""

from __future__ import annotations

from pathlib import Path

from worker.geometry.cloud.occupancy_grid import OccupancyGrid


def write_occupancy(directory: Path, grid: OccupancyGrid) -> list[Path]:
    """Write ``occupancy-grid.pgm`` (binary) and ``occupancy-grid.yaml`` and return their paths.

    ``free_thresh`` is 0.196 as in ROS's `map_saver`: grey 205 gives (255 - 205) / 255 = 0.19608, just
    unknown.
    """
    image, description = directory / "occupancy-grid.pgm", directory / "occupancy-grid.yaml"
    height, width = grid.cells.shape
    image.write_bytes(f"P5\n{width} {height}\n255\n".encode() + grid.cells.tobytes())
    description.write_text(
        f"image: {image.name}\n"
        "mode: trinary\n"
        f"resolution: {grid.resolution:.6g}\n"
        f"origin: [{grid.origin[0]:.6f}, {grid.origin[1]:.6f}, 0.0]\n"
        "negate: 0\n"
        "occupied_thresh: 0.65\n"
        "free_thresh: 0.196\n",
        encoding="utf-8",
    )
    return [image, description]
