"""The NDT objective with its gradient and Hessian (Magnusson 2009, equations 6.9 to 6.13), compiled.

The pose is varied on the left and about a centre c: a point p = R x + t goes to
``c + exp(w) (p - c) + v`` with xi = (v, w). At xi = 0 this gives J = [I | -[q]x] with q = p - c, and
the second derivatives of the rotation in closed form, so no Euler angle ever enters (unlike 6.17 to 6.21).

Points are summed in chunks of fixed size and the chunks in their order: the result has the same
bits whatever the number of threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numba import get_num_threads, njit, prange, set_num_threads
from numpy.typing import NDArray

from worker.geometry.registration.cells import find_row
from worker.geometry.registration.ndt_map import NdtMap

_CHUNK = 32
_UPPER = np.triu_indices(6)
_AS_THEY_ARE = np.eye(4)
_WORTH_THREADS = 2_000


def derivatives(
    points: NDArray[np.float64],
    ndt_map: NdtMap,
    *,
    centre: NDArray[np.float64],
    pose: NDArray[np.float64] | None = None,
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the NDT score of placed points, its gradient and its Hessian in xi = (v, w) at 0.

    The score is *maximal* at the best pose (PCL's sign): the sum of ``-d1 exp(-d2/2 m^2)`` over every
    point and every Gaussian whose mean is at most `resolution` away, m being the Mahalanobis distance.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Source points [m].
    ndt_map : NdtMap
        The target.
    centre : ndarray of shape (3,), float64
        Point about which w turns, in the map's frame [m].
    pose : ndarray of shape (4, 4), float64, optional
        Takes the points to the map's frame; where there is none they are in it.

    Returns
    -------
    tuple
        Score, gradient (6,) and Hessian (6, 6) of the score.

    Notes
    -----
    O(N) with about 0.2 to 0.5 us a point and core. Neighbours as `pcl::VoxelGridCovariance::radiusSearch`
    with the radius `resolution`, which lie within the 27 cells around the point's own.
    """
    d1, d2 = ndt_map.gauss
    placing = _AS_THEY_ARE if pose is None else np.ascontiguousarray(pose)
    with _threads_for(len(points)):
        sums = _accumulate(
            points, placing, centre, ndt_map.means, ndt_map.inverse_covariances, ndt_map.table_keys,
            ndt_map.table_bricks, ndt_map.row_starts, ndt_map.row_cells, ndt_map.resolution, d1, d2,
        )  # fmt: skip
    total = np.add.reduce(sums, axis=0)
    hessian = np.zeros((6, 6))
    hessian[_UPPER] = total[7:]
    hessian.T[_UPPER] = total[7:]
    return float(total[0]), total[1:7], hessian


def score_points(
    points: NDArray[np.float64], ndt_map: NdtMap
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each placed point's sum and maximum over its near Gaussians of ``-d1 exp(-d2/2 m^2)``.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        Source points in the map's frame [m].
    ndt_map : NdtMap
        The target.
    """
    d1, d2 = ndt_map.gauss
    with _threads_for(len(points)):
        both = _score_each(
        points, ndt_map.means, ndt_map.inverse_covariances, ndt_map.table_keys, ndt_map.table_bricks,
        ndt_map.row_starts, ndt_map.row_cells, ndt_map.resolution, d1, d2,
    )  # fmt: skip
    return both[:, 0], both[:, 1]


@contextmanager
def _threads_for(count: int) -> Iterator[None]:
    """Let compiled loops over few points run on one thread: waking others costs more than it gives."""
    before = get_num_threads()
    if count < _WORTH_THREADS:
        set_num_threads(1)
    try:
        yield
    finally:
        set_num_threads(before)


@njit(cache=True, parallel=True)
def _accumulate(  # noqa: PLR0913, PLR0917 - compiled code takes plain arrays
    points: NDArray[np.float64],
    pose: NDArray[np.float64],
    centre: NDArray[np.float64],
    means: NDArray[np.float64],
    inverses: NDArray[np.float64],
    table_keys: NDArray[np.int64],
    table_bricks: NDArray[np.int32],
    row_starts: NDArray[np.int32],
    row_cells: NDArray[np.int32],
    resolution: float,
    d1: float,
    d2: float,
) -> NDArray[np.float64]:
    """Return score, gradient and upper Hessian of each chunk of points, (chunks, 28)."""
    chunks = (len(points) + _CHUNK - 1) // _CHUNK
    sums = np.zeros((chunks, 28))
    half = (chunks + 1) // 2
    for nth in prange(chunks):
        chunk = 2 * nth if nth < half else 2 * (nth - half) + 1  # threads share dense and empty places alike
        out = sums[chunk]
        for n in range(chunk * _CHUNK, min(len(points), (chunk + 1) * _CHUNK)):
            a, b, c = points[n, 0], points[n, 1], points[n, 2]
            x = pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * c + pose[0, 3]
            y = pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * c + pose[1, 3]
            z = pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * c + pose[2, 3]
            row = find_row(x, y, z, 1.0 / resolution, table_keys, table_bricks)
            if row < 0:
                continue
            qx, qy, qz = x - centre[0], y - centre[1], z - centre[2]
            for at in range(row_starts[row], row_starts[row + 1]):
                m = row_cells[at]
                dx, dy, dz = x - means[m, 0], y - means[m, 1], z - means[m, 2]
                if dx * dx + dy * dy + dz * dz > resolution * resolution:
                    continue
                _add(out, inverses[m], dx, dy, dz, qx, qy, qz, d1, d2)
    return sums


@njit(cache=True, inline="always")
def _add(  # noqa: PLR0913, PLR0917 - compiled code takes plain numbers
    out: NDArray[np.float64],
    b: NDArray[np.float64],
    dx: float,
    dy: float,
    dz: float,
    qx: float,
    qy: float,
    qz: float,
    d1: float,
    d2: float,
) -> None:
    """Add one point and one Gaussian to score, gradient (6.12) and Hessian (6.13)."""
    # u = C^-1 d
    ux = b[0] * dx + b[1] * dy + b[2] * dz
    uy = b[1] * dx + b[3] * dy + b[4] * dz
    uz = b[2] * dx + b[4] * dy + b[5] * dz
    e = -d1 * np.exp(-0.5 * d2 * (dx * ux + dy * uy + dz * uz))  # equation 6.9
    f = -d2 * e
    # g = J^T u, J = [I | -[q]x], hence the turning part is q x u
    gx, gy, gz = qy * uz - qz * uy, qz * ux - qx * uz, qx * uy - qy * ux
    out[0] += e
    out[1] += f * ux
    out[2] += f * uy
    out[3] += f * uz
    out[4] += f * gx
    out[5] += f * gy
    out[6] += f * gz
    # B J_w with B = C^-1: column k is B (e_k x q)
    b00, b01, b02 = b[2] * qy - b[1] * qz, b[0] * qz - b[2] * qx, b[1] * qx - b[0] * qy
    b10, b11, b12 = b[4] * qy - b[3] * qz, b[1] * qz - b[4] * qx, b[3] * qx - b[1] * qy
    b20, b21, b22 = b[5] * qy - b[4] * qz, b[2] * qz - b[5] * qx, b[4] * qx - b[2] * qy
    # Row 1 to 3 of equation 6.13: -d2 u u^T + B, and the mixed block
    out[7] += f * (b[0] - d2 * ux * ux)
    out[8] += f * (b[1] - d2 * ux * uy)
    out[9] += f * (b[2] - d2 * ux * uz)
    out[10] += f * (b00 - d2 * ux * gx)
    out[11] += f * (b01 - d2 * ux * gy)
    out[12] += f * (b02 - d2 * ux * gz)
    out[13] += f * (b[3] - d2 * uy * uy)
    out[14] += f * (b[4] - d2 * uy * uz)
    out[15] += f * (b10 - d2 * uy * gx)
    out[16] += f * (b11 - d2 * uy * gy)
    out[17] += f * (b12 - d2 * uy * gz)
    out[18] += f * (b[5] - d2 * uz * uz)
    out[19] += f * (b20 - d2 * uz * gx)
    out[20] += f * (b21 - d2 * uz * gy)
    out[21] += f * (b22 - d2 * uz * gz)
    # Turning block: J_w^T B J_w - d2 g g^T + u . d2p/dw2, where
    # u . 1/2 (ei x (ej x q) + ej x (ei x q)) = 1/2 (u_i q_j + u_j q_i) - delta_ij (u . q)
    uq = ux * qx + uy * qy + uz * qz
    out[22] += f * (qy * b20 - qz * b10 - d2 * gx * gx + ux * qx - uq)
    out[23] += f * (qy * b21 - qz * b11 - d2 * gx * gy + 0.5 * (ux * qy + uy * qx))
    out[24] += f * (qy * b22 - qz * b12 - d2 * gx * gz + 0.5 * (ux * qz + uz * qx))
    out[25] += f * (qz * b01 - qx * b21 - d2 * gy * gy + uy * qy - uq)
    out[26] += f * (qz * b02 - qx * b22 - d2 * gy * gz + 0.5 * (uy * qz + uz * qy))
    out[27] += f * (qx * b12 - qy * b02 - d2 * gz * gz + uz * qz - uq)


@njit(cache=True, parallel=True)
def _score_each(  # noqa: PLR0913, PLR0917 - compiled code takes plain arrays
    points: NDArray[np.float64],
    means: NDArray[np.float64],
    inverses: NDArray[np.float64],
    table_keys: NDArray[np.int64],
    table_bricks: NDArray[np.int32],
    row_starts: NDArray[np.int32],
    row_cells: NDArray[np.int32],
    resolution: float,
    d1: float,
    d2: float,
) -> NDArray[np.float64]:
    """Return sum and maximum over the near Gaussians, (N, 2)."""
    both = np.zeros((len(points), 2))
    for n in prange(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        row = find_row(x, y, z, 1.0 / resolution, table_keys, table_bricks)
        if row < 0:
            continue
        for at in range(row_starts[row], row_starts[row + 1]):
            c = row_cells[at]
            dx, dy, dz = x - means[c, 0], y - means[c, 1], z - means[c, 2]
            if dx * dx + dy * dy + dz * dz > resolution * resolution:
                continue
            b = inverses[c]
            m = dx * (b[0] * dx + b[1] * dy + b[2] * dz)
            m += dy * (b[1] * dx + b[3] * dy + b[4] * dz) + dz * (b[2] * dx + b[4] * dy + b[5] * dz)
            e = -d1 * np.exp(-0.5 * d2 * m)
            both[n, 0] += e
            both[n, 1] = max(both[n, 1], e)
    return both
