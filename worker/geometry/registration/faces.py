"""The upright faces of a building, seen from above: what a tablet sees of walls and columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit
from numpy.typing import NDArray

from worker.geometry.drawing.reading.reading import Column, Wall
from worker.geometry.registration.visibility import Solids

ALONG_STEP = 0.05


@dataclass(frozen=True, eq=False)
class Faces:
    """Hold S face segments.

    Parameters
    ----------
    begin, end : ndarrays of shape (S, 2), float64
        In frame `map` [m].
    outward : ndarray of shape (S, 2), float64
        Unit direction in which each face looks, away from the solid.
    solids : Solids
        What hides faces that stand against it.
    """

    begin: NDArray[np.float64]
    end: NDArray[np.float64]
    outward: NDArray[np.float64]
    solids: Solids

    @classmethod
    def of(cls, walls: Sequence[Wall], columns: Sequence[Column]) -> Faces:
        """Return the faces of walls and columns."""
        begins, ends, outs = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros((0, 2))]
        for wall in walls:
            for face, side in zip(wall.faces, (1.0, -1.0), strict=True):
                along = np.diff(face, axis=0)
                begins.append(face[:-1])
                ends.append(face[1:])
                outs.append(side * np.column_stack([-along[:, 1], along[:, 0]]))
        for column in columns:
            ring = np.vstack([column.outline, column.outline[:1]])
            x, y = ring[:, 0], ring[:, 1]
            turning = np.sign(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) or 1.0
            along = np.diff(ring, axis=0)
            begins.append(ring[:-1])
            ends.append(ring[1:])
            outs.append(turning * np.column_stack([along[:, 1], -along[:, 0]]))
        begin, end, out = np.vstack(begins), np.vstack(ends), np.vstack(outs)
        length = np.hypot(out[:, 0], out[:, 1])
        kept = length > 1e-9
        out = out[kept] / length[kept, None]
        return cls(begin[kept], end[kept], out, Solids.of(walls, columns))

    @cached_property
    def samples(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return places on the faces that can be seen, 5 cm apart (M, 2) [m], and where they look (M, 2)."""
        along = self.end - self.begin
        length = np.hypot(along[:, 0], along[:, 1])
        counts = np.maximum(np.ceil(length / ALONG_STEP).astype(np.int64), 1)
        which = np.repeat(np.arange(len(counts)), counts)
        place = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        share = (place + 0.5) / counts[which]
        feet = self.begin[which] + share[:, None] * along[which]
        outward = self.outward[which]
        seen = ~self.solids.hides(feet, outward)
        return feet[seen], outward[seen]

    def hidden_from(
        self,
        eye: NDArray[np.float64],
        points: NDArray[np.float64],
        *,
        clearance: float = 0.25,
        give: float = 0.0,
    ) -> NDArray[np.bool_]:
        """Return which points stand behind a face, seen from `eye`.

        Parameters
        ----------
        eye : ndarray of shape (2,), float64
            Where the tablet was [m]. A tablet that walked around a corner has seen behind it rightly.
        points : ndarray of shape (N, 2), float64
            [m].
        clearance : float
            The face is crossed at least so far before the point [m].
        give : float
            And it would be so if the faces stood this much to any side of where they are drawn [m].
        """
        hidden = np.ones(len(points), dtype=np.bool_)
        begin, end = self._between(eye, points, give=give)
        for aside in np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])[: 5 if give else 1] * give:
            left = np.ascontiguousarray(points[hidden] + aside)
            hidden[hidden] = _crossed(begin, end, eye + aside, left, 0.0, -clearance)
        return hidden

    def _between(
        self, eye: NDArray[np.float64], points: NDArray[np.float64], *, give: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return both ends of the faces that may come between an eye (2,) and points (N, 2), N >= 0."""
        every = np.vstack([points, eye])
        low, high = every.min(axis=0) - give, every.max(axis=0) + give
        near = (np.maximum(self.begin, self.end) >= low) & (np.minimum(self.begin, self.end) <= high)
        kept = near.all(axis=1)
        return self.begin[kept], self.end[kept]

    def backs(self, eye: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 2) [m] have a face behind them, seen from `eye` (2,)."""
        return _crossed(
            self.begin, self.end, np.ascontiguousarray(eye), np.ascontiguousarray(points), 1.0, np.inf
        )


@njit(cache=True)
def _crossed(
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    eye: NDArray[np.float64],
    points: NDArray[np.float64],
    least: float,
    beyond: float,
) -> NDArray[np.bool_]:
    """Return for each point whether a segment crosses its line of sight.

    The crossing lies farther from the eye than `least` times the distance of the point, and nearer than that
    distance plus `beyond` [m].
    """
    crossed = np.zeros(len(points), dtype=np.bool_)
    for n in range(len(points)):
        rx, ry = points[n, 0] - eye[0], points[n, 1] - eye[1]
        length = np.hypot(rx, ry)
        for k in range(len(begin)):
            ax, ay = end[k, 0] - begin[k, 0], end[k, 1] - begin[k, 1]
            tx, ty = begin[k, 0] - eye[0], begin[k, 1] - eye[1]
            across = rx * ay - ry * ax
            if abs(across) < 1e-12:
                continue
            t, u = (tx * ay - ty * ax) / across, (tx * ry - ty * rx) / across
            if least < t and t * length < length + beyond and 0.0 <= u <= 1.0:
                crossed[n] = True
                break
    return crossed
