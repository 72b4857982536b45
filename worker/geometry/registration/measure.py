"""Measurements of a placed scan, each of which becomes a member of the evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.registration.surfaces import Surfaces

INLIER_DISTANCE = 0.1
REACH = 0.3
UPRIGHT = 0.3
"""Normals whose z is less than this belong to walls."""
_LEAST_STRUCTURE = 100
_SHELVES = 2.2
_WEAK = 0.02
ALIGNED = np.cos(np.deg2rad(15.0))
"""Level normals whose product is more than this look the same way."""
_SAME_PLANE = 0.15
GLIMPSE = 0.02
"""Share of the upright inliers that tells that a wall was seen at all."""
_LEAST_PLANE_SHARE = 0.04
_LEAST_PLANE_POINTS = 25
_DRAWN_SHIFT = 0.03
_DRAWN_TURN = np.deg2rad(0.5)
_DRAWN_END = 0.05
_NAMES = ("x", "y", "z", "tilt", "tilt", "yaw")


@dataclass(frozen=True, eq=False)
class Fit:
    """Hold how each of N compared points lies on the map at one pose.

    Parameters
    ----------
    placed : ndarray of shape (N, 3)
        Points in frame `map` [m].
    distance : ndarray of shape (N,)
        Signed distance to the matched plane [m].
    plane : ndarray of shape (N, 3)
        Normal of that plane.
    inlier, upright, structure : ndarrays of shape (N,), bool
        On a surface of the map; upright; upright and above furniture.
    """

    placed: NDArray[np.float64]
    distance: NDArray[np.float64]
    plane: NDArray[np.float64]
    inlier: NDArray[np.bool_]
    upright: NDArray[np.bool_]
    structure: NDArray[np.bool_]

    @property
    def inlier_share(self) -> float:
        """Return the share of all points that are inliers."""
        return float(np.mean(self.inlier))

    @property
    def structure_share(self) -> float:
        """Return the share of the structure that is inlier."""
        return float(np.mean(self.inlier[self.structure])) if self.structure.any() else 0.0


def measure_fit(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    surfaces: Surfaces,
    *,
    pose: Transform,
    structure_from: float | None,
) -> Fit:
    """Return how the points lie on the surfaces at a pose.

    Parameters
    ----------
    points, normals : ndarrays of shape (N, 3), float64
        The thinned scan in frame `scan`; zero normals where it is not flat.
    surfaces : Surfaces
        In frame `map`.
    pose : Transform
        `T_map_scan`.
    structure_from : float or None
        Upright points above this z in frame `map` are structure [m]; all upright ones if None.
    """
    placed, turned = pose.apply(points), normals @ pose.rotation.T
    distance, plane, found = surfaces.match(placed, turned, reach=REACH)
    upright = (np.abs(turned[:, 2]) < UPRIGHT) & (np.linalg.norm(turned, axis=1) > 0.5)
    structure = upright if structure_from is None else _above(placed[:, 2], upright, structure_from)
    return Fit(placed, distance, plane, found & (np.abs(distance) < INLIER_DISTANCE), upright, structure)


def _above(z: NDArray[np.float64], upright: NDArray[np.bool_], structure_from: float) -> NDArray[np.bool_]:
    """Return the upright points above shelves and cabinets where a third of those above tables lies there."""
    tables = upright & (z > structure_from)
    shelves = upright & (z > _SHELVES)
    if np.count_nonzero(shelves) >= max(_LEAST_STRUCTURE, np.count_nonzero(tables) / 3):
        return shelves
    return tables if np.count_nonzero(tables) >= _LEAST_STRUCTURE else upright


def information(fit: Fit, *, unknowns: tuple[int, ...]) -> tuple[tuple[float, ...], tuple[str, ...]]:
    """Return the eigenvalues of the inliers' normal equations a point, and the names of weak motions.

    Parameters
    ----------
    fit : Fit
        At the pose.
    unknowns : tuple of int
        Motions that have to be determined by the surfaces; the others are held by gravity.

    Returns
    -------
    tuple
        Six ascending eigenvalues, turns scaled to metres at the inliers' own size; names of the motions among
        `unknowns` with an eigenvalue under 0.02: hardly a fiftieth of the points resist them.
    """
    if not fit.inlier.any():
        return (0.0,) * 6, ("x", "y", "z", "yaw")
    p, n = fit.placed[fit.inlier], fit.plane[fit.inlier]
    q = p - p.mean(axis=0)
    lever = max(float(np.sqrt(np.mean(np.sum(q**2, axis=1)))), 1e-3)
    J = np.hstack([n, np.cross(q, n) / lever])
    H = J.T @ J / len(p)
    keep = np.array(unknowns)
    values, vectors = np.linalg.eigh(H[np.ix_(keep, keep)])
    weak = [_name(vectors[:, k], unknowns) for k in np.flatnonzero(values < _WEAK)]
    full = np.linalg.eigvalsh(H)
    return tuple(float(v) for v in full), tuple(dict.fromkeys(weak))


def map_error_effect(fit: Fit, *, pose: Transform, unknowns: tuple[int, ...]) -> tuple[float, float]:
    """Return one sigma of the pose, [m] and [rad], if every wall is drawn 3 cm and half a degree wrong.

    A drawing deviates from its building by centimetres. Where walls stand on all sides that averages out
    and shows in the residuals; where the walls hold the pose just so, it moves the pose, by more than itself
    if they meet at a flat angle, and no residual tells. Long walls are turned less: no end is 5 cm off by it.

    Parameters
    ----------
    fit : Fit
        At the pose.
    pose : Transform
        `T_map_scan`; the effect is that on its origin.
    unknowns : tuple of int
        The motions that are free.

    Returns
    -------
    tuple
        Standard deviation of the worst level direction [m] and of the yaw [rad]; infinite if nothing is held.

    Notes
    -----
    The sandwich ``A^-1 (sum_k s_k s_k^T) A^-1`` with A the normal equations and s_k the sum of the Jacobian
    over surface k, all of whose points err together, once shifted and once turned about its middle.
    """
    keep = np.array(unknowns)
    p, n = fit.placed[fit.inlier], fit.plane[fit.inlier]
    if len(p) < len(keep):
        return float("inf"), float("inf")
    J = np.hstack([n, np.cross(p - pose.translation, n)])[:, keep]
    A = J.T @ J
    if np.linalg.cond(A) > 1e10:
        return float("inf"), float("inf")
    columns = []
    for member in _surfaces_of(p, n):
        along = n[member, 0] * p[member, 1] - n[member, 1] * p[member, 0]
        columns.append(_DRAWN_SHIFT * J[member].sum(axis=0))
        off = along - along.mean()
        turn = min(_DRAWN_TURN, _DRAWN_END / max(float(np.abs(off).max()), 1e-9))
        columns.append(turn * (off @ J[member]))
    half = np.linalg.solve(A, np.array(columns).T)
    covariance = half @ half.T
    level = [i for i, k in enumerate(unknowns) if k in {0, 1}]
    yaw = unknowns.index(5)
    worst = float(np.linalg.eigvalsh(covariance[np.ix_(level, level)])[-1])
    return float(np.sqrt(worst)), float(np.sqrt(covariance[yaw, yaw]))


def _surfaces_of(p: NDArray[np.float64], n: NDArray[np.float64]) -> list[NDArray[np.intp]]:
    """Return the points of each surface as indices: headings within 10 degrees, offsets within 0.25 m."""
    heading = np.round(np.arctan2(n[:, 1], n[:, 0]) / np.deg2rad(20.0)) * (np.abs(n[:, 2]) < 0.7)
    offset = np.floor(np.sum(n * (p - p.mean(axis=0)), axis=1) / 0.5)
    _, member = np.unique(np.column_stack([heading, offset]), axis=0, return_inverse=True)
    order = np.argsort(member.ravel(), kind="stable")
    return np.split(order, np.flatnonzero(np.diff(member.ravel()[order])) + 1)


def _name(vector: NDArray[np.float64], unknowns: tuple[int, ...]) -> str:
    """Return the name of a motion: an axis, or the heading of a level direction."""
    xi = np.zeros(6)
    xi[list(unknowns)] = vector
    if np.hypot(xi[0], xi[1]) > 0.8 and max(abs(xi[0]), abs(xi[1])) < 0.97:
        return f"along {np.rad2deg(np.arctan2(xi[1], xi[0])) % 180.0:.0f} deg"
    return _NAMES[int(np.argmax(np.abs(xi)))]


def upright_planes(
    fit: Fit, among: NDArray[np.bool_], *, sided: bool, least_share: float = _LEAST_PLANE_SHARE
) -> NDArray[np.float64]:
    """Return the distinct upright planes of the map on which upright inliers lie.

    Parameters
    ----------
    fit : Fit
        At the pose.
    among : ndarray of shape (N,), bool
        Points that count, such as the structure.
    sided : bool
        Whether the two faces of a wall count as two.
    least_share : float
        Share of these inliers that makes a plane.

    Returns
    -------
    ndarray of shape (K, 3), float64
        Level normal, towards where it is seen from if sided, and offset [m] from the inliers' middle.

    Notes
    -----
    Greedy: the most populated of 24 headings times 0.1 m offsets, with the points around it, is counted and
    taken away, until what is left is less than a plane.
    """
    upright = fit.inlier & among & (np.abs(fit.plane[:, 2]) < UPRIGHT)
    p, n = fit.placed[upright, :2], fit.plane[upright, :2]
    p = p - p.mean(axis=0) if len(p) else p
    n = n / np.maximum(np.linalg.norm(n, axis=1, keepdims=True), 1e-9)
    if not sided:
        flipped = (n[:, 1] < 0) | ((n[:, 1] == 0) & (n[:, 0] < 0))
        n = np.where(flipped[:, None], -n, n)
    least = max(_LEAST_PLANE_POINTS, least_share * len(p))
    planes = []
    while len(p) >= least:
        heading = np.round(np.arctan2(n[:, 1], n[:, 0]) / np.deg2rad(15.0)).astype(np.int64)
        offset = np.round(np.sum(n * p, axis=1) / 0.1).astype(np.int64)
        _, inverse, sizes = np.unique(heading * 100_000 + offset, return_inverse=True, return_counts=True)
        seed = inverse == int(np.argmax(sizes))
        n0 = n[seed].sum(axis=0)
        n0 /= max(float(np.linalg.norm(n0)), 1e-9)
        c0 = float(np.median(p[seed] @ n0))
        facing = n @ n0 if sided else np.abs(n @ n0)
        member = (facing > ALIGNED) & (np.abs(p @ n0 - c0) < _SAME_PLANE)
        if np.count_nonzero(member) >= least:
            planes.append((*n0, c0))
        member |= seed
        p, n = p[~member], n[~member]
    return np.array(planes, dtype=np.float64).reshape(-1, 3)


def closed_directions(planes: NDArray[np.float64]) -> int:
    """Return in how many directions two of the planes face each other, as walls of a room do: 0, 1 or 2.

    Where they do, a size of the room is confirmed: hardly another place has the same in two directions.

    Parameters
    ----------
    planes : ndarray of shape (K, 3), float64
        Of `upright_planes`, sided.
    """
    headings = planes[_faced(planes), :2]
    if not len(headings):
        return 0
    return 2 if (np.abs(headings @ headings[0]) < np.sqrt(0.5)).any() else 1


def open_directions(planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the normals (M, 2) of planes that, like all others along them, face no other.

    Parameters
    ----------
    planes : ndarray of shape (K, 3), float64
        Of `upright_planes`, sided.
    """
    normals, faced = planes[:, :2], _faced(planes)
    along = np.abs(normals @ normals.T) > ALIGNED
    return np.asarray(normals[~(along & faced[None]).any(axis=1)], dtype=np.float64)


def _faced(planes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of the planes (K, 3) face another one."""
    n, c = planes[:, :2], planes[:, 2]
    opposite = (n @ n.T < -ALIGNED) & (c[:, None] + c[None] < 0)
    return np.asarray(opposite.any(axis=1), dtype=np.bool_)
