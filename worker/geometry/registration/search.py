"""Placement search: where a scan may have been taken, from a rough pose or from none.

The upright structure of the scan is correlated with the faces of the walls, seen from above, over every
yaw and position; the best are pulled onto the faces; those for which the tablet would have had to see
through walls go down. What comes back are hypotheses in their order, for a refinement in all six
dimensions to decide on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration.face_field import correlate, face_field
from worker.geometry.registration.neighbours import NeighbourGrid
from worker.geometry.registration.structure import Structure

_YAW_STEP = np.deg2rad(2.5)
_MARGIN = 1.0
_MOST_PEAKS, _FEW_PEAKS, _LEAST_PEAK = 96, 12, 0.5
_HEADINGS, _RARE, _ALIKE = 72, 0.005, 0.8
_APART_PEAKS, _TURN_PEAKS = 0.5, np.deg2rad(7.0)
_APART, _TURN = 0.2, np.deg2rad(3.0)
_ROUNDS = (0.6, 0.6, 0.5, 0.4, 0.3, 0.3, 0.25, 0.25, 0.2, 0.2)
_SIDE_WEIGHT = 0.5
_ON_FACE = 0.12
_THROUGH_WEIGHT = 0.5


class Outline(Protocol):
    """What a map shows of its walls, seen from above."""

    @property
    def samples(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return places on faces (M, 2) [m] and the unit directions in which they look (M, 2)."""
        ...

    def hidden_from(
        self, eye: NDArray[np.float64], points: NDArray[np.float64], *, clearance: float = ...
    ) -> NDArray[np.bool_]:
        """Return which points (N, 2) stand behind a wall, seen from `eye` (2,) [m]."""
        ...


@dataclass(frozen=True)
class Region:
    """Hold where the scan's origin may lie in frame `map` [m], and how it may be turned [rad]."""

    x: float
    y: float
    yaw: float
    radius: float
    turn: float


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Hold H poses seen from above, the most likely first.

    Parameters
    ----------
    poses : ndarray of shape (H, 3), float64
        x, y [m] and yaw [rad] of `T_map_scan`.
    on_faces, through_walls : ndarrays of shape (H,), float64
        Share of the structure that lies within 12 cm of a face that looks its way; share that the tablet
        would have had to see through a wall.
    tried : int
        Poses compared.
    """

    poses: NDArray[np.float64]
    on_faces: NDArray[np.float64]
    through_walls: NDArray[np.float64]
    tried: int

    @property
    def score(self) -> NDArray[np.float64]:
        """Return what the hypotheses are ordered by."""
        return self.on_faces - _THROUGH_WEIGHT * self.through_walls


def search(
    structure: Structure, outline: Outline, *, region: Region | None, thorough: bool = True
) -> Hypotheses:
    """Return where the structure fits the faces, anywhere or within a region; none where nothing fits.

    Parameters
    ----------
    structure : Structure
        The scan's, with at least one piece.
    outline : Outline
        The map's.
    region : Region, optional
        Around a rough pose; the whole map where there is none.
    thorough : bool
        Whether every yaw is tried and 96 peaks are followed, or only those yaws at which most of the
        structure looks as faces of the map do, and 12.

    Notes
    -----
    Exhaustive at 20 cm and 2.5 degrees; then point-to-line steps with Tukey's biweight for all peaks at once.
    """
    feet, outward = outline.samples
    if not len(feet):
        return Hypotheses(np.zeros((0, 3)), np.zeros(0), np.zeros(0), 0)
    poses, tried = _peaks(structure, feet, outward, region, thorough=thorough)
    if not len(poses):
        return Hypotheses(np.zeros((0, 3)), np.zeros(0), np.zeros(0), tried)
    grid = NeighbourGrid.of(_flat(feet), _flat(outward))
    for reach in _ROUNDS:
        poses = _step(structure, poses, grid, feet, outward, reach)
    on_faces = _on_faces(structure, poses, grid, feet, outward)
    inside = np.ones(len(poses), dtype=bool) if region is None else _within(poses, region)
    order = np.flatnonzero(inside)[np.argsort(-on_faces[inside], kind="stable")]
    order = order[_distinct(poses[order], apart=_APART, turn=_TURN)]
    order = order[on_faces[order] >= 0.5 * on_faces[order[0]]] if len(order) else order
    through = np.array([_through(structure, poses[i], outline) for i in order])
    found = Hypotheses(poses[order], on_faces[order], through, tried)
    best = np.argsort(-found.score, kind="stable")
    return Hypotheses(found.poses[best], found.on_faces[best], found.through_walls[best], tried)


def _peaks(
    structure: Structure,
    feet: NDArray[np.float64],
    outward: NDArray[np.float64],
    region: Region | None,
    *,
    thorough: bool,
) -> tuple[NDArray[np.float64], int]:
    """Return the best distinct poses of an exhaustive coarse search, and how many were tried."""
    reach = float(np.linalg.norm(structure.xy, axis=1).max()) + _MARGIN
    if region is None:
        yaws = np.arange(0.0, 2.0 * np.pi, _YAW_STEP)
        window = (feet.min(axis=0) - _MARGIN, feet.max(axis=0) + _MARGIN)
        near = np.arange(len(feet))
    else:
        steps = int(np.ceil(region.turn / _YAW_STEP))
        yaws = region.yaw + np.arange(-steps, steps + 1) * _YAW_STEP
        middle = np.array([region.x, region.y])
        window = (middle - region.radius, middle + region.radius)
        near = np.flatnonzero(np.linalg.norm(feet - middle, axis=1) < region.radius * np.sqrt(2.0) + reach)
        if not len(near):
            return np.zeros((0, 3)), 0
    if not thorough:
        yaws = yaws[_alike(structure.outward, outward[near], yaws)]
    field = face_field(feet[near], outward[near], margin=1.0)
    poses, scores = correlate(
        field, structure.xy, structure.outward, yaws=yaws, window=window, least=_LEAST_PEAK
    )
    tried = len(yaws) * int(np.prod(np.ceil((window[1] - window[0]) / 0.2)))
    most = _MOST_PEAKS if thorough else _FEW_PEAKS
    top = np.argsort(-scores, kind="stable")[: 40 * most]
    top = top[_distinct(poses[top], apart=_APART_PEAKS, turn=_TURN_PEAKS, most=most)]
    return poses[top], tried


def _alike(
    looks: NDArray[np.float64], outward: NDArray[np.float64], yaws: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return at which yaws (Y,) nearly as much of the structure looks as faces do as at any."""
    step = 2.0 * np.pi / _HEADINGS
    of_faces = np.round(np.arctan2(outward[:, 1], outward[:, 0]) / step).astype(np.int64) % _HEADINGS
    there = np.bincount(of_faces, minlength=_HEADINGS) >= _RARE * len(outward)
    there |= np.roll(there, 1) | np.roll(there, -1)
    turned = np.arctan2(looks[:, 1], looks[:, 0])[None] + yaws[:, None]
    share = there[np.round(turned / step).astype(np.int64) % _HEADINGS].mean(axis=1)
    return np.asarray(share >= _ALIKE * share.max(), dtype=np.bool_)


def _distinct(
    poses: NDArray[np.float64], *, apart: float, turn: float, most: int | None = None
) -> NDArray[np.intp]:
    """Return the indices of poses that no earlier one kept is near."""
    kept: list[int] = []
    for i in range(len(poses)):
        others = poses[kept]
        off = np.hypot(others[:, 0] - poses[i, 0], others[:, 1] - poses[i, 1])
        if not np.any((off < apart) & (np.abs(_wrapped(others[:, 2] - poses[i, 2])) < turn)):
            kept.append(i)
            if len(kept) == most:
                break
    return np.array(kept, dtype=np.intp)


def _wrapped(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles between -pi and pi."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi, dtype=np.float64)


def _within(poses: NDArray[np.float64], region: Region) -> NDArray[np.bool_]:
    off = np.hypot(poses[:, 0] - region.x, poses[:, 1] - region.y)
    return np.asarray(
        (off <= region.radius) & (np.abs(_wrapped(poses[:, 2] - region.yaw)) <= region.turn), dtype=np.bool_
    )


def _placed(
    structure: Structure, poses: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places and directions (H, K, 2) of the structure at each pose."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    return (
        np.einsum("hij,kj->hki", turn, structure.xy) + poses[:, None, :2],
        np.einsum("hij,kj->hki", turn, structure.outward),
    )


def _flat(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 2) as (N, 3), their height 0."""
    return np.column_stack([places, np.zeros(len(places))])


def _matched(
    structure: Structure,
    poses: NDArray[np.float64],
    grid: NeighbourGrid,
    feet: NDArray[np.float64],
    outward: NDArray[np.float64],
    reach: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return places (H, K, 2), distances to faces (H, K), their normals (H, K, 2), matched (H, K)."""
    p, n = _placed(structure, poses)
    _, index = grid.nearest(
        _flat(p.reshape(-1, 2)), _flat(n.reshape(-1, 2)), reach=float(np.sqrt(2.0) * reach),
        weight=_SIDE_WEIGHT, most=float(np.hypot(reach, 0.5 * _SIDE_WEIGHT)),
    )  # fmt: skip
    found = (index >= 0).reshape(p.shape[:2])
    index = np.where(found, index.reshape(found.shape), 0)
    between, normal = p - feet[index], outward[index]
    distance = np.sum(between * normal, axis=2)
    aside = np.abs(between[..., 0] * normal[..., 1] - between[..., 1] * normal[..., 0])
    found &= (np.abs(distance) < reach) & (aside < reach)
    return p, distance, normal, found


def _step(
    structure: Structure,
    poses: NDArray[np.float64],
    grid: NeighbourGrid,
    feet: NDArray[np.float64],
    outward: NDArray[np.float64],
    reach: float,
) -> NDArray[np.float64]:
    """Return the poses after one Gauss-Newton step each, in x, y and yaw about the structure's middle."""
    p, r, n, found = _matched(structure, poses, grid, feet, outward, reach)
    weight = np.where(found, (1.0 - (r / reach) ** 2) ** 2, 0.0)
    middle = p.mean(axis=1, keepdims=True)
    q = p - middle
    J = np.concatenate([n, (q[..., :1] * n[..., 1:] - q[..., 1:] * n[..., :1])], axis=2)
    H = np.einsum("hki,hkj,hk->hij", J, J, weight) + 1e-3 * len(structure) * np.eye(3)
    g = np.einsum("hki,hk,hk->hi", J, r, weight)
    xi = -np.linalg.solve(H, g[..., None])[..., 0]
    xi *= np.minimum(1.0, 0.3 / np.maximum(np.abs(xi).max(axis=1, keepdims=True), 1e-9))
    c, s = np.cos(xi[:, 2]), np.sin(xi[:, 2])
    off = poses[:, :2] - middle[:, 0]
    moved = np.stack([c * off[:, 0] - s * off[:, 1], s * off[:, 0] + c * off[:, 1]], axis=1)
    return np.column_stack([middle[:, 0] + moved + xi[:, :2], poses[:, 2] + xi[:, 2]])


def _on_faces(
    structure: Structure,
    poses: NDArray[np.float64],
    grid: NeighbourGrid,
    feet: NDArray[np.float64],
    outward: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the share of the structure within 12 cm of a face that looks its way, (H,)."""
    found = _matched(structure, poses, grid, feet, outward, _ON_FACE)[3]
    return np.asarray(found.mean(axis=1), dtype=np.float64)


def _through(structure: Structure, pose: NDArray[np.float64], outline: Outline) -> float:
    """Return the share of the structure that stands behind a wall as seen by the tablet."""
    p, _ = _placed(structure, pose[None])
    c, s = np.cos(pose[2]), np.sin(pose[2])
    eye = pose[:2] + np.array([(c, -s), (s, c)]) @ structure.viewpoint
    return float(np.mean(outline.hidden_from(eye, p[0])))
