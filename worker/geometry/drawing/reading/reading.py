"""What was read from a drawing: walls, columns, and everything that was set aside."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.domain.drawing_reading import SourceLayer
from service.domain.findings import Finding
from worker.geometry.drawing.scale.decision import Scale

Unit = Literal["m", "px"]

_ASSUMED_SHEET = 30.0
"""How long a reading of unknown scale is taken to be [m] where a threshold needs metres: a small hall."""


@dataclass(frozen=True, eq=False)
class Wall:
    """Hold one wall as its centre line and its two faces.

    Parameters
    ----------
    centre : ndarray of shape (K, 2), float64
        Centre line [m], K >= 2.
    thickness : float
        Distance between the faces [m].
    faces : tuple of two ndarrays of shape (F, 2), float64
        The surfaces that a LiDAR sees [m]: left and right of the centre line's direction.
    kind : str
        ``wall``, or ``partition`` where the drawing shows it as a single line.
    confidence : float
        How sure the reading is that this is a wall, 0 to 1.
    reason : str
        What makes it a wall, as a sentence; empty where the kind says it all.
    """

    centre: NDArray[np.float64]
    thickness: float
    faces: tuple[NDArray[np.float64], NDArray[np.float64]]
    kind: str = "wall"
    confidence: float = 1.0
    reason: str = ""

    @classmethod
    def of(cls, centre: NDArray[np.float64], *, thickness: float, kind: str = "wall") -> Wall:
        """Return a wall whose faces run parallel to the (K, 2) centre line, half the thickness [m] away."""
        left = offset_polyline(centre, thickness / 2)
        right = offset_polyline(centre, -thickness / 2)
        return cls(centre, thickness, (left, right), kind)

    @property
    def length(self) -> float:
        """Return the length of the centre line [m]."""
        return float(np.hypot(*np.diff(self.centre, axis=0).T).sum())


@dataclass(frozen=True, eq=False)
class Column:
    """Hold a column or pier as its (K, 2) outline [m], without the closing point."""

    outline: NDArray[np.float64]
    kind: str = "column"


@dataclass(frozen=True, eq=False)
class RemovedStroke:
    """Hold linework that was set aside: where [m], in which layer, and why.

    Parameters
    ----------
    lines : tuple of ndarrays of shape (K, 2), float64
        The strokes themselves [m].
    layer : str
        ``text``, ``dimension``, ``hatch``, ``furniture``, ``stair``, ``frame``, ``small``, ``other`` ...
    reason : str
        The measurement that decided, as a sentence.
    """

    lines: tuple[NDArray[np.float64], ...]
    layer: str
    reason: str


@dataclass(frozen=True, eq=False)
class Reading:
    """Hold what was read from a drawing, in frame `drawing`: x right, y up, origin at the sheet's lower left.

    Parameters
    ----------
    walls, columns, removed : tuple
        What was kept, and what was set aside.
    sheet : tuple of float
        Width and height of the sheet, in `unit`.
    scale : Scale
        With its evidence; while it is unknown every coordinate is in pixels or drawing units.
    style : str
        How the drawing shows walls: ``filled``, ``outlined`` or ``single-line``.
    findings : tuple of Finding
        Remarks for the person who looks at the reading.
    counts : dict of str to int
        What else was counted, by members of `DrawingCounts`.
    origin : tuple of float
        Where the origin of frame `drawing` lies in the file's own coordinates, in `unit`.
    layers : tuple of SourceLayer
        The layers of a vector file, and as what each was taken.
    confidence : float
        How sure the reading is of itself as a whole, 0 to 1.
    top : float or None
        Where y = 0 of the file's own coordinates lies, in `unit`, if they run downwards as pixels do; None
        where they run up: then they are the reading's, plus `origin`.
    """

    walls: tuple[Wall, ...]
    columns: tuple[Column, ...]
    removed: tuple[RemovedStroke, ...]
    sheet: tuple[float, float]
    scale: Scale
    style: str
    findings: tuple[Finding, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    origin: tuple[float, float] = (0.0, 0.0)
    layers: tuple[SourceLayer, ...] = ()
    confidence: float = 1.0
    top: float | None = None

    @property
    def unit(self) -> Unit:
        """Return the unit of every coordinate."""
        return "px" if self.scale.metres_per_unit is None else "m"

    @property
    def metres_a_unit(self) -> float:
        """Return metres a unit for thresholds: 1, or where the scale is unknown what makes the sheet 30 m."""
        return 1.0 if self.unit == "m" else _ASSUMED_SHEET / max(*self.sheet, 1e-9)

    def scaled(self, factor: float) -> Reading:
        """Return the reading with every coordinate and length times `factor`; its scale stays as it is."""
        return replace(
            self,
            walls=tuple(
                replace(
                    w,
                    centre=w.centre * factor,
                    thickness=w.thickness * factor,
                    faces=(w.faces[0] * factor, w.faces[1] * factor),
                )
                for w in self.walls
            ),
            columns=tuple(replace(c, outline=c.outline * factor) for c in self.columns),
            removed=tuple(replace(r, lines=tuple(x * factor for x in r.lines)) for r in self.removed),
            sheet=(self.sheet[0] * factor, self.sheet[1] * factor),
            origin=(self.origin[0] * factor, self.origin[1] * factor),
            top=None if self.top is None else self.top * factor,
            layers=tuple(replace(x, length=x.length * factor) for x in self.layers),
        )


def offset_polyline(line: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Return the (K, 2) line moved sideways by `distance`, to its left where positive, with mitred corners.

    A mitre is cut at twice the distance, so that a sharp corner throws no spike.
    """
    step = np.diff(line, axis=0)
    length = np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-12)
    normal = np.column_stack([-step[:, 1], step[:, 0]]) / length[:, None]
    before = np.vstack([normal[:1], normal])
    after = np.vstack([normal, normal[-1:]])
    bisector = before + after
    squared = np.maximum((bisector**2).sum(axis=1), 1e-12)
    mitre = bisector * (2.0 / squared)[:, None]
    mitre *= np.minimum(1.0, 2.0 / np.maximum(np.hypot(mitre[:, 0], mitre[:, 1]), 1e-12))[:, None]
    return np.asarray(line + mitre * distance, dtype=np.float64)
