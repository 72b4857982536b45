"""Placements by the hundred: how many are right, accepted, wrongly accepted, as uncertain as they say.

``GROUNDPLAN_TRIALS`` is the number of trials of each kind (12 unless set), ``GROUNDPLAN_FIRST_TRIAL`` the
first.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.acceptance import judge
from service.domain.errors import PlacementNotComputed
from service.domain.transform import Transform
from tests.benchmarks.buildings import (
    CORNER,
    FULL_TURN,
    THREE_WALLS,
    Building,
    a_building,
    a_scan,
    a_walk,
    rough,
)
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall
from worker.geometry.registration.place import Placed, place_scan
from worker.geometry.registration.target import PlacementTarget

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(36_000)]

RIGHT_M, RIGHT_RAD = 0.1, np.deg2rad(1.0)
CHI2_95_6 = 12.592
SCALE, BEND = 0.01, np.deg2rad(1.5)
BUILDINGS = 20


@dataclass(frozen=True, eq=False)
class Trial:
    """Hold points to place, where; `truth` is None where no right pose exists."""

    points: NDArray[np.float64]
    walls: tuple[Wall, ...]
    building: Building
    near: Transform
    truth: Transform | None


@dataclass(frozen=True)
class Outcome:
    """Hold what came of a trial: whether the pose is right, the verdict, whether the error is as stated."""

    right: bool
    verdict: str
    inside: bool
    offset_m: float
    reasons: tuple[str, ...] = ()


def _plain(building: Building, seed: int, turn: float) -> Trial:
    scan = a_scan(building, seed, turn=turn)
    return Trial(scan.cloud.points.copy(), building.drawn, building, scan.T_map_scan, scan.T_map_scan)


def _room(building: Building, seed: int) -> Trial:
    return _plain(building, seed, FULL_TURN)


def _three(building: Building, seed: int) -> Trial:
    return _plain(building, seed, THREE_WALLS)


def _corner(building: Building, seed: int) -> Trial:
    return _plain(building, seed, CORNER)


def _walked(building: Building, seed: int) -> Trial:
    scan = a_walk(building, seed)
    return Trial(scan.cloud.points.copy(), building.drawn, building, scan.T_map_scan, scan.T_map_scan)


def _bent(points: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Return points turned by up to 0.75 degrees to either side as the tablet turned on."""
    sign = 1.0 if seed % 2 else -1.0
    turn = sign * BEND * np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi)
    c, s = np.cos(turn), np.sin(turn)
    x, y = points[:, 0], points[:, 1]
    return np.column_stack([c * x - s * y, s * x + c * y, points[:, 2]])


def _deformed(trial: Trial, points: NDArray[np.float64]) -> Trial:
    """Return a trial with other points; the truth is the rigid pose that suits them best."""
    assert trial.truth is not None
    a, b = points - points.mean(axis=0), trial.points - trial.points.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    fit = np.eye(4)
    fit[:3, :3], fit[:3, 3] = turn, trial.points.mean(axis=0) - turn @ points.mean(axis=0)
    return replace(trial, points=points, truth=trial.truth @ Transform(fit))


def _scaled(building: Building, seed: int) -> Trial:
    trial = _room(building, seed)
    return _deformed(trial, trial.points * (1.0 + SCALE * (1.0 if seed % 2 else -1.0)))


def _bend(building: Building, seed: int) -> Trial:
    trial = _room(building, seed)
    return _deformed(trial, _bent(trial.points, seed))


def _three_bent(building: Building, seed: int) -> Trial:
    trial = _three(building, seed)
    return _deformed(trial, _bent(trial.points, seed) * (1.0 + SCALE * (1.0 if seed % 3 else -1.0)))


def _mirrored(building: Building, seed: int) -> Trial:
    trial = _room(building, seed)
    return replace(trial, points=trial.points * (1.0, -1.0, 1.0), truth=None)


def _elsewhere(building: Building, seed: int) -> Trial:
    other = a_building(100_000 + seed)
    return replace(_room(other, seed), walls=building.drawn, building=building, truth=None)


def _wrong_room(building: Building, seed: int) -> Trial:
    """Return a trial whose room lacks the walls within it in the drawing; those that go on beyond it stay."""
    trial = _room(building, seed)
    assert trial.truth is not None
    room = building.room_at(trial.truth.translation[:2])
    low, high = room[:2] - 0.3, room[2:] + 0.3
    middles = np.array([w.centre.mean(axis=0) for w in building.drawn])
    of_room = np.all((low < middles) & (middles < high), axis=1)
    kept = tuple(w for w, drop in zip(building.drawn, of_room, strict=True) if not drop)
    return replace(trial, walls=kept)


def _moved_wall(building: Building, seed: int) -> Trial:
    """Return a trial in which one of the longest walls near the tablet is drawn elsewhere."""
    rng = np.random.default_rng(seed)
    trial = _room(building, seed)
    assert trial.truth is not None
    eye = trial.truth.translation[:2]
    near = [k for k, w in enumerate(building.drawn) if _distance(eye, w) < 5.0]
    near.sort(key=lambda k: -building.drawn[k].length)
    k = near[int(rng.integers(min(3, len(near))))]
    wall = building.drawn[k]
    along = wall.centre[-1] - wall.centre[0]
    aside = (
        np.array([-along[1], along[0]]) / np.linalg.norm(along) * rng.uniform(0.3, 1.0) * rng.choice([-1, 1])
    )
    moved = Wall.of(wall.centre + aside, thickness=wall.thickness)
    return replace(trial, walls=(*building.drawn[:k], moved, *building.drawn[k + 1 :]))


def _distance(eye: NDArray[np.float64], wall: Wall) -> float:
    a, b = wall.centre[0], wall.centre[-1]
    t = float(np.clip((eye - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0))
    return float(np.linalg.norm(a + t * (b - a) - eye))


KINDS: dict[str, Callable[[Building, int], Trial]] = {
    "whole room": _room,
    "three walls": _three,
    "bare corner": _corner,
    "through a door": _walked,
    "1 % scale": _scaled,
    "1.5 degrees bent": _bend,
    "three walls, both": _three_bent,
    "mirrored": _mirrored,
    "another building": _elsewhere,
    "room not drawn": _wrong_room,
    "wall moved": _moved_wall,
}


def outcome(kind: str, seed: int) -> Outcome:
    """Return what comes of one trial: with no pose, within 3 m and 45 degrees, or within 0.7 m and 10."""
    trial = KINDS[kind](a_building(seed % BUILDINGS), seed)
    rng = np.random.default_rng(seed + 7)
    far = (None, (3.0, 45.0), (0.7, 10.0))[seed % 3]
    initial = None if far is None else rough(trial.near, rng, metres=far[0], degrees=far[1])
    target = PlacementTarget.from_faces(trial.walls, wall_height=trial.building.height)
    try:
        placed = place_scan(PointCloud.of(trial.points), target, initial=initial)
    except PlacementNotComputed:
        return Outcome(False, "refused", inside=False, offset_m=np.inf)
    judged = judge(placed.evidence)
    told = tuple(reason.detail for reason in judged.reasons)
    if trial.truth is None:
        return Outcome(False, judged.verdict, inside=False, offset_m=np.inf, reasons=told)
    offset, turn = placed.T_map_scan.distance_to(trial.truth)
    right = offset < RIGHT_M and turn < RIGHT_RAD
    return Outcome(right, judged.verdict, _as_stated(placed, trial.truth), offset, told)


def _as_stated(placed: Placed, truth: Transform) -> bool:
    """Return whether the true error lies in the 95 % ellipsoid of the stated covariance."""
    off = np.zeros(6)
    off[:3] = placed.T_map_scan.translation - truth.translation
    turn = placed.T_map_scan.rotation @ truth.rotation.T
    off[3:] = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2.0
    covariance = np.array(placed.evidence.covariance)
    return bool(off @ np.linalg.solve(covariance, off) <= CHI2_95_6)


def test_trials() -> None:
    count, first = (
        int(os.environ.get(f"GROUNDPLAN_{k}", d)) for k, d in (("TRIALS", 12), ("FIRST_TRIAL", 0))
    )
    print(f"\n{'':18} trials right accepted  of right   false accepts  in its 95 % ellipsoid  median error")
    false = []
    for kind in KINDS:
        results = [(seed, outcome(kind, seed)) for seed in range(first, first + count)]
        accepted = [o for _, o in results if o.verdict == "accepted"]
        right = [o for _, o in results if o.right]
        taken = [o for o in accepted if o.right]
        false += [(kind, seed) for seed, o in results if o.verdict == "accepted" and not o.right]
        share = f"{len(taken) / len(right):9.1%}" if right else "        -"
        inside = f"{sum(o.inside for o in taken) / len(taken):9.1%}" if taken else "        -"
        median = f"{np.median([o.offset_m for o in right]):.4f} m" if right else "-"
        print(
            f"{kind:18} {count:6} {len(right):5} {len(accepted):8} {share} {len(accepted) - len(taken):15} "
            f"{inside:>22} {median:>13}",
            flush=True,
        )
    print(f"false accepts: {false}")
