"""The file's own coordinates against frame `drawing`, and names of strokes that rest on them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall

Box = tuple[float, float, float, float]

_STEPS = 10_000
_NUMBERS = re.compile(r"[swc](-?[\d.]+)_(-?[\d.]+)_(-?[\d.]+)_(-?[\d.]+)")


@dataclass(frozen=True)
class FileFrame:
    """Hold how coordinates of the file (pixels y down, or drawing units y up) become those of a reading.

    Parameters
    ----------
    factor : float
        Units of the reading in one unit of the file: metres, or 1 while the scale is unknown.
    origin : tuple of float
        What is taken off, in the reading's unit.
    top : float or None
        Where y = 0 of the file lies, in the reading's unit, if y runs downwards there.
    extent : float
        The longer side of the sheet, in the file's unit.
    """

    factor: float
    origin: tuple[float, float]
    top: float | None
    extent: float

    @classmethod
    def of(cls, reading: Reading) -> FileFrame:
        """Return the frame of the file that a reading was made from."""
        factor = reading.scale.metres_per_unit or 1.0
        return cls(factor, reading.origin, reading.top, max(*reading.sheet, 1e-9) / factor)

    def to_drawing(self, points: Sequence[tuple[float, float]] | NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 2) points of the file in the reading's frame."""
        xy = np.asarray(points, dtype=np.float64) * self.factor
        y = xy[:, 1] - self.origin[1] if self.top is None else self.top - xy[:, 1]
        return np.column_stack([xy[:, 0] - self.origin[0], y])

    def to_file(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 2) points of the reading in the file's own coordinates."""
        y = points[:, 1] + self.origin[1] if self.top is None else self.top - points[:, 1]
        return np.column_stack([points[:, 0] + self.origin[0], y]) / self.factor

    def box(self, lines: Iterable[NDArray[np.float64]]) -> Box:
        """Return the smallest box around lines of the reading, in the file's own coordinates."""
        corners = np.array([(*line.min(axis=0), *line.max(axis=0)) for line in lines])
        ends = self.to_file(np.stack([corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)]))
        (x0, y0), (x1, y1) = ends.min(axis=0), ends.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)


@dataclass(frozen=True)
class StrokeIds:
    """Hold a name for each wall, column and removed stroke of a reading, in their order.

    A name is its kind (``w``, ``c``, ``s``) and the stroke's box in the file's own coordinates, at a
    ten-thousandth of the sheet: ``s1024.5_338.0_1180.2_352.1``; where two strokes have one box, the second
    ends in ``~2``. So the same file gives the same names, whatever scale is given, and a stroke that a later
    reading finds a little elsewhere is still recognised.
    """

    walls: tuple[str, ...]
    columns: tuple[str, ...]
    removed: tuple[str, ...]


def stroke_ids(reading: Reading) -> StrokeIds:
    """Return the names of everything in a reading."""
    frame = FileFrame.of(reading)
    seen: dict[str, int] = {}
    return StrokeIds(
        tuple(_name("w", frame.box(outline(w)), frame, seen) for w in reading.walls),
        tuple(_name("c", frame.box(outline(c)), frame, seen) for c in reading.columns),
        tuple(_name("s", frame.box(outline(r)), frame, seen) for r in reading.removed),
    )


def outline(item: Wall | Column | RemovedStroke) -> tuple[NDArray[np.float64], ...]:
    """Return the lines that one sees of an item: the faces of a wall, the outline of a column."""
    if isinstance(item, Wall):
        return item.faces
    return (item.outline,) if isinstance(item, Column) else item.lines


def box_of_id(stroke_id: str) -> Box:
    """Return the box in the file's own coordinates that a stroke's name holds.

    Raises
    ------
    ValueError
        If it is no such name; edits are checked before they come here.
    """
    found = _NUMBERS.match(stroke_id)
    if found is None:
        msg = f"{stroke_id!r} is no name of a stroke"
        raise ValueError(msg)
    x0, y0, x1, y1 = (float(number) for number in found.groups())
    return x0, y0, x1, y1


def turn_of_id(stroke_id: str) -> int:
    """Return which of several strokes of one box a name means, counted from 1."""
    _, _, turn = stroke_id.partition("~")
    return int(turn) if turn else 1


def _name(kind: str, box: Box, frame: FileFrame, seen: dict[str, int]) -> str:
    decimals = max(0, -math.floor(math.log10(frame.extent / _STEPS)))
    name = kind + "_".join(f"{round(v, decimals) + 0.0:.{decimals}f}" for v in box)
    seen[name] = seen.get(name, 0) + 1
    return name if seen[name] == 1 else f"{name}~{seen[name]}"
