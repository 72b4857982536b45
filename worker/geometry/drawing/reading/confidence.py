"""How sure a reading can be of itself: as a whole, and of each wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.findings import Finding
from worker.geometry.drawing.reading.bodies import wall_body
from worker.geometry.drawing.reading.reading import Reading, Wall

LEAST = 0.6
"""Below this a reading says of itself that it should not be trusted."""

_REACH = 0.3
_THINNEST, _THICKEST = 0.03, 1.2
_SMALLEST, _LARGEST = 4.0, 400.0
_LONG = 0.5
_DIRECTIONS = 4
_BIN_DEG = 1


@dataclass(frozen=True)
class Marks:
    """Hold what a reading's confidence rests on, each from 0 (speaks against it) to 1.

    Parameters
    ----------
    connected : float
        Share of wall ends, by number, that lie within 30 cm of another wall or column.
    faced : float
        Share of the walls' length that has two faces.
    long : float
        Share of the walls' length in walls of at least 50 cm.
    aligned : float
        Share of the walls' length along the four most frequent directions, within 2 degrees.
    thick : float
        Share of the faced walls' length that is between 3 cm and 1.2 m thick.
    explained : float
        Share of all strokes' length that the walls account for.
    sized : float
        Whether the walls' extent is that of a building: 4 to 400 m; 1 while the scale is unknown.
    """

    connected: float
    faced: float
    long: float
    aligned: float
    thick: float
    explained: float
    sized: float

    @property
    def confidence(self) -> float:
        """Return the product of the marks, each weakened where it may well be low in a good drawing."""
        return float(
            _share(0.5 + self.connected, of=0.9)
            * _share(self.long, of=0.7)
            * _share(self.aligned, of=0.55) ** 1.5
            * _share(self.explained, of=0.15) ** 0.5
            * _share(self.thick, of=0.9) ** 0.5
            * (0.85 + 0.15 * self.faced)
            * self.sized
        )


def judge(reading: Reading) -> Reading:
    """Return the reading with its confidence and that of each wall, and a finding where it is low.

    The finding ``low-confidence`` (serious) tells which marks are low. A high confidence does not tell that
    the walls are right: a clean drawing of something else than a building has one too.
    """
    metres = reading.metres_a_unit
    if not reading.walls:
        return replace(reading, confidence=0.0)
    touched = _touched_ends(reading, _REACH / metres)
    marks = _marks(reading, touched, metres)
    walls = tuple(
        replace(w, confidence=min(w.confidence, _of_wall(w, ends, metres, reading.style)))
        for w, ends in zip(reading.walls, touched.sum(axis=1).tolist(), strict=True)
    )
    confidence = min(reading.confidence, marks.confidence)
    findings = reading.findings
    if confidence < LEAST:
        findings = (*findings, _low(confidence, marks))
    return replace(reading, walls=walls, confidence=confidence, findings=findings)


def _marks(reading: Reading, touched: NDArray[np.bool_], metres: float) -> Marks:
    length = np.array([w.length for w in reading.walls])
    total = max(float(length.sum()), 1e-9)
    faced = np.array([w.thickness > 0 and w.kind == "wall" for w in reading.walls])
    thickness = np.array([w.thickness for w in reading.walls]) * metres
    plausible = (thickness >= _THINNEST) & (thickness <= _THICKEST)
    return Marks(
        connected=float(touched.mean()),
        faced=float(length[faced].sum() / total),
        long=float(length[length * metres >= _LONG].sum() / total),
        aligned=_aligned(reading.walls),
        thick=float(length[faced & plausible].sum() / max(float(length[faced].sum()), 1e-9))
        if faced.any()
        else 1.0,
        explained=_explained(reading),
        sized=1.0 if reading.unit == "px" else _sized(reading),
    )


def _touched_ends(reading: Reading, reach: float) -> NDArray[np.bool_]:
    """Return (N, 2): whether each end of each wall lies near another wall or column."""
    bodies = [_body(w) for w in reading.walls]
    others: list[Any] = [*bodies, *(shapely.Polygon(c.outline).buffer(0) for c in reading.columns)]
    ends = np.array([(w.centre[0], w.centre[-1]) for w in reading.walls])
    points = shapely.points(ends.reshape(-1, 2))
    asked, found = shapely.STRtree(others).query(points, predicate="dwithin", distance=reach)
    touched = np.zeros(len(points), dtype=bool)
    touched[asked[found != asked // 2]] = True
    return touched.reshape(-1, 2)


def _body(wall: Wall) -> Any:
    if wall.thickness <= 0:
        return shapely.LineString(wall.centre)
    return wall_body(wall)


def _aligned(walls: Sequence[Wall]) -> float:
    steps = np.vstack([np.diff(w.centre, axis=0) for w in walls])
    length = np.hypot(steps[:, 0], steps[:, 1])
    bins = 180 // _BIN_DEG
    degrees = np.degrees(np.arctan2(steps[:, 1], steps[:, 0])) % 180.0
    histogram = np.bincount((degrees / _BIN_DEG).astype(int) % bins, weights=length, minlength=bins)
    total, share = max(float(histogram.sum()), 1e-9), 0.0
    for _ in range(_DIRECTIONS):
        wide = histogram + np.roll(histogram, 1)
        best = int(wide.argmax())
        share += float(wide[best])
        histogram[[best, best - 1]] = 0.0
    return share / total


def _explained(reading: Reading) -> float:
    kept = sum(w.length * (2.0 if w.kind == "wall" else 1.0) for w in reading.walls)
    aside = _length([line for stroke in reading.removed for line in stroke.lines])
    return kept / max(kept + aside, 1e-9)


def _length(lines: Sequence[NDArray[np.float64]]) -> float:
    """Return how long lines are together."""
    if not lines:
        return 0.0
    steps = np.diff(np.concatenate(lines), axis=0)
    between = np.cumsum([len(line) for line in lines])[:-1] - 1
    length = np.hypot(steps[:, 0], steps[:, 1])
    length[between] = 0.0
    return float(length.sum())


def _sized(reading: Reading) -> float:
    corners = np.vstack([w.centre for w in reading.walls])
    extent = float(np.ptp(corners, axis=0).max())
    return min(1.0, extent / _SMALLEST, _LARGEST / max(extent, 1e-9))


def _of_wall(wall: Wall, touched: int, metres: float, style: str) -> float:
    """Return how sure one wall is: by its faces, its ends, its length and its thickness."""
    sure = 1.0 if wall.kind == "wall" else (0.85 if style == "single-line" else 0.7)
    sure *= (0.75, 0.95, 1.0)[touched]
    sure *= 1.0 if wall.length * metres >= _LONG else 0.85
    thickness = wall.thickness * metres
    return sure * (1.0 if thickness <= _THICKEST and (thickness >= _THINNEST or wall.kind != "wall") else 0.5)


def _share(mark: float, *, of: float) -> float:
    """Return a mark as a share of what is enough of it."""
    return min(max(mark / of, 0.0), 1.0)


def _low(confidence: float, marks: Marks) -> Finding:
    told = {f"{name}_mark": round(float(value), 3) for name, value in vars(marks).items()}
    return Finding(
        "low-confidence",
        "serious",
        f"This reading is not sure of itself ({confidence:.2f} of 1): look at the preview before a map is "
        "made from it. The walls found hardly make up a building: see the marks.",
        {"confidence": round(confidence, 3), **told},
    )
