"""Several starts for one placement, and which of their ends are the same pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.transform import Transform
from worker.geometry.registration.ndt import LEVELLED, moved, register_ndt
from worker.geometry.registration.ndt_map import NdtMap

SAME_DISTANCE = 0.1
SAME_TURN = np.deg2rad(1.0)
_SHIFT = 0.5
_TURN = np.deg2rad(8.0)
_OFFSETS = (
    (0.0, 0.0, 0.0), (_SHIFT, 0.0, 0.0), (-_SHIFT, 0.0, 0.0), (0.0, _SHIFT, 0.0), (0.0, -_SHIFT, 0.0),
    (0.0, 0.0, _TURN), (0.0, 0.0, -_TURN),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class End:
    """Hold a pose at which starts ended: how many, the NDT score a point, and the work done."""

    T_map_scan: Transform
    score: float
    starts: int
    converged: bool
    iterations: int


def start_poses(initial: Transform, centre: NDArray[np.float64]) -> tuple[Transform, ...]:
    """Return the rough pose and six poses around it: half a metre aside, 8 degrees turned.

    Parameters
    ----------
    initial : Transform
        The rough `T_map_scan`.
    centre : ndarray of shape (3,), float64
        Place in frame `map` about which to turn [m].
    """
    return tuple(moved(initial, np.array([x, y, 0.0, 0.0, 0.0, w]), centre) for x, y, w in _OFFSETS)


def ends_of(
    points: NDArray[np.float64],
    maps: Sequence[NdtMap],
    *,
    starts: Sequence[Transform],
    told: Callable[[float], None],
) -> list[End]:
    """Return the distinct poses at which NDT from the starts ended, the best score first.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The thinned scan in its frame [m].
    maps : sequence of NdtMap
        Coarse to fine. The scan's z axis stays up.
    starts : sequence of Transform
        Where to begin.
    told : callable
        Told the share of the work done.
    """
    ends: list[End] = []
    for done, start in enumerate(starts):
        told(done / len(starts))
        pose, score, iterations, converged = start, 0.0, 0, True
        for ndt_map in maps:
            last = ndt_map is maps[-1]
            result = register_ndt(
                points, ndt_map, initial=pose, unknowns=LEVELLED,
                tolerance=1e-3 if last else 1e-2, max_iterations=60 if last else 30,
            )  # fmt: skip
            pose, score = result.T_target_source, result.score / len(points)
            iterations += result.iterations
            converged = result.converged
        ends.append(End(pose, score, 1, converged, iterations))
    return merge_ends(ends, points.mean(axis=0))


def merge_ends(
    ends: Sequence[End],
    middle: NDArray[np.float64],
    *,
    apart: float = SAME_DISTANCE,
    turned: float = SAME_TURN,
) -> list[End]:
    """Return the ends with those that are one pose made one, the best score first.

    Parameters
    ----------
    ends : sequence of End
        In any order.
    middle : ndarray of shape (3,), float64
        The scan's middle in its own frame: poses are compared by where they put it [m].
    apart, turned : float
        Nearer than this two are one [m], [rad].
    """
    distinct: list[End] = []
    for end in sorted(ends, key=lambda e: -e.score):
        for k, kept in enumerate(distinct):
            off, turn = apart_at(kept.T_map_scan, end.T_map_scan, middle)
            if off < apart and turn < turned:
                distinct[k] = End(
                    kept.T_map_scan, kept.score, kept.starts + end.starts, kept.converged,
                    kept.iterations + end.iterations,
                )  # fmt: skip
                break
        else:
            distinct.append(end)
    return distinct


def apart_at(a: Transform, b: Transform, middle: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far apart two poses put the place `middle` (3,) [m], and the angle between them [rad]."""
    places = a.apply(middle[None]) - b.apply(middle[None])
    return float(np.linalg.norm(places)), a.distance_to(b)[1]
