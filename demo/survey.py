"""The tablet's part that needs no service: walk around the new machine, write the file, guess the place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from demo.hall import Hall
from service.domain.transform import Transform
from worker.geometry.lidar.tablet import TabletPath, TabletScan, scan_with_tablet


def scan_of_new_machine(hall: Hall, *, seed: int) -> TabletScan:
    """Return the scan of the new machine with its surrounding walls.

    A person walks once around the machine with the tablet towards it, then stands still and turns once, so
    that the room's walls are in the scan too.
    """
    shop, machine = hall.shop.floor, hall.new_machine
    rng = np.random.default_rng((seed, 1))
    angles = rng.uniform(0.0, 2.0 * np.pi) + np.linspace(0.0, 2.0 * np.pi, 13)
    reach = np.hypot(machine.length, machine.width) / 2 + 1.2
    ring = np.array([machine.x, machine.y]) + reach * np.column_stack([np.cos(angles), np.sin(angles)])
    ring = np.clip(ring, (shop.x0 + 0.5, shop.y0 + 0.5), (shop.x1 - 0.5, shop.y1 - 0.5))
    around = TabletPath.walking(ring, look_at=(machine.x, machine.y), frames=48)
    turn = TabletPath.turning(ring[-1], start_yaw=float(around.yaws[-1]), frames=40)
    back = TabletPath.turning(ring[6], start_yaw=float(around.yaws[24]), frames=40)
    return scan_with_tablet(hall.scene, around.then(turn).then(back), seed=seed)


def rough_pose(truth: Transform, *, seed: int, off: float = 0.5, turn_deg: float = 8.0) -> Transform:
    """Return what a person says about a pose: `off` [m] away in some direction, turned by `turn_deg`."""
    rng = np.random.default_rng((seed, 2))
    direction = rng.uniform(-np.pi, np.pi)
    step = np.array([off * np.cos(direction), off * np.sin(direction), 0.0])
    x, y, z = truth.translation + step
    turn = np.deg2rad(turn_deg) * rng.choice([-1.0, 1.0])
    return Transform.from_xyz_yaw(float(x), float(y), float(z), truth.rpy[2] + float(turn))


def ply_bytes(points: NDArray[np.float64]) -> bytes:
    """Return (N, 3) points as a binary little-endian PLY file with single precision x, y, z [m]."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment metres, z up\n"
        f"element vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    return header.encode("ascii") + points.astype("<f4").tobytes()
