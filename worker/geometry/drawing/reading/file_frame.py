"""The file's own coordinates against frame `drawing`, and names of strokes that rest on them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
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

    def boxes(self, items: Sequence[Wall | Column | RemovedStroke]) -> list[Box]:
        """Return the smallest box around what one sees of each item, in the file's own coordinates."""
        corners = boxes_around(items)
        one, other = self.to_file(corners[:, :2]), self.to_file(corners[:, 2:])
        return [
            (x0, y0, x1, y1)
            for x0, y0, x1, y1 in np.hstack([np.minimum(one, other), np.maximum(one, other)]).tolist()
        ]


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
        tuple(_names("w", frame.boxes(reading.walls), frame, seen)),
        tuple(_names("c", frame.boxes(reading.columns), frame, seen)),
        tuple(_names("s", frame.boxes(reading.removed), frame, seen)),
    )


def outline(item: Wall | Column | RemovedStroke) -> tuple[NDArray[np.float64], ...]:
    """Return the lines that one sees of an item: the faces of a wall, the outline of a column."""
    if isinstance(item, Wall):
        return item.faces
    return (item.outline,) if isinstance(item, Column) else item.lines


def boxes_around(items: Sequence[Wall | Column | RemovedStroke]) -> NDArray[np.float64]:
    """Return (N, 4) left, bottom, right, top of what one sees of each item, in the reading's frame."""
    lines = [outline(item) for item in items]
    return boxes_of([line for own in lines for line in own], [sum(map(len, own)) for own in lines])


def boxes_of(lines: Sequence[NDArray[np.float64]], size: Sequence[int]) -> NDArray[np.float64]:
    """Return (N, 4) left, bottom, right, top of N runs of the lines' points, each of so many, one or more."""
    if not size:
        return np.zeros((0, 4))
    points, count = np.concatenate(lines), np.array(size)
    first = np.cumsum(count) - count
    return np.hstack([np.minimum.reduceat(points, first), np.maximum.reduceat(points, first)])


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


def _names(kind: str, boxes: Sequence[Box], frame: FileFrame, seen: dict[str, int]) -> Iterator[str]:
    decimals = max(0, -math.floor(math.log10(frame.extent / _STEPS)))
    form, zero = kind + "_".join([f"%.{decimals}f"] * 4), f"{0:.{decimals}f}"
    for box in boxes:
        name = (form % box).replace(f"-{zero}", zero)
        seen[name] = seen.get(name, 0) + 1
        yield name if seen[name] == 1 else f"{name}~{seen[name]}"
