"""Linework while a page's strokes are being collected: chained, clipped, counted."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import DrawingTooComplex
from service.domain.findings import Finding
from worker.geometry.drawing.linework.curves import Arc, Point, arc_of
from worker.geometry.drawing.linework.linework import Linework

Box = tuple[float, float, float, float]
"""Left, bottom, right, top."""

_WHITE = 0xF8
_SAME = 1e-3
_FARTHEST = 1e7


@dataclass(frozen=True)
class Pen:
    """Hold how a stroke is drawn: layer, width [mm on paper], colour 0xRRGGBB, dashed, filled."""

    layer: str = ""
    width: float = math.nan
    colour: int = 0
    dashed: bool = False
    filled: bool = False

    @property
    def is_white(self) -> bool:
        """Return whether the pen leaves nothing to see on white paper."""
        return min(self.colour >> 16 & 0xFF, self.colour >> 8 & 0xFF, self.colour & 0xFF) >= _WHITE


class LineworkDraft:
    """Collect the strokes of a page in its unit, x right, y up.

    Strokes that go on where the last one ended, with the same pen, become one entity: many programs write
    a polyline or an arc as lines one by one.

    Parameters
    ----------
    page : tuple of float
        Left, bottom, right, top of the page: what lies outside is cut off.
    most : int
        Segments that are taken at most.
    """

    def __init__(self, page: Box, *, most: int) -> None:
        self.page = page
        self.white = self.wild = 0
        self._most = most
        self._ends = array("d")
        self._entity = array("q")
        self._clip = array("q")
        self._kinds: list[str] = []
        self._closed: list[bool] = []
        self._pen: list[int] = []
        self._pens: dict[Pen, int] = {}
        self._clips: dict[Box, int] = {page: 0}
        self._last: Point | None = None
        self._arcs: list[Arc] = []

    def add(
        self,
        points: Sequence[Point],
        *,
        pen: Pen,
        kind: str = "",
        closed: bool = False,
        clip: Box | None = None,
        again: bool = False,
    ) -> None:
        """Add a polyline of points; one that is `closed` or filled gets its last side.

        With `again` it is a further ring of the area that was added before: its hole, or another part. A
        white area is kept as a ``mask``: it hides what was drawn before it; a white stroke is left out.

        Raises
        ------
        DrawingTooComplex
            If there are more segments than are taken.
        """
        if pen.is_white and not pen.filled:
            self.white += 1
            return
        if points and not _is_near(points):
            self.wild += 1
            return
        if (closed or pen.filled) and len(points) > 2 and points[0] != points[-1]:
            points = [*points, points[0]]
        if len(points) < 2:
            return
        shut = closed or _near(points[0], points[-1])
        if again and self._kinds:
            entity = len(self._kinds) - 1
        else:
            entity = self._entity_for(points, pen=pen, kind=kind, closed=shut)
        window = self._clips.setdefault(clip or self.page, len(self._clips))
        self._ends.extend(itertools.chain.from_iterable(map(itertools.chain, points[:-1], points[1:])))
        self._entity.extend(itertools.repeat(entity, len(points) - 1))
        self._clip.extend(itertools.repeat(window, len(points) - 1))
        self._last = None if shut or kind else points[-1]
        self.expect(0)

    def expect(self, count: int) -> None:
        """Refuse the drawing if so many more segments would be too many.

        Raises
        ------
        DrawingTooComplex
            If there would be more segments than are taken.
        """
        if len(self._entity) + count > self._most:
            raise DrawingTooComplex(
                f"The drawing has more than {self._most} strokes; export only the floor that is needed, "
                "or print the sheet as a PNG image.",
                max_strokes=self._most,
            )

    def add_arc(self, arc: Arc) -> None:
        """Add a circular arc whose chords were added before."""
        self._arcs.append(arc)

    def __len__(self) -> int:
        return len(self._entity)

    def finish(self, *, page_mm_per_unit: float | None) -> Linework:
        """Return the strokes as linework, cut to the page and to their clipping windows."""
        ends = np.frombuffer(self._ends, dtype=np.float64).reshape(-1, 2, 2).copy()
        entity = np.frombuffer(self._entity, dtype=np.int64).copy()
        windows = np.array(list(self._clips), dtype=np.float64)
        ends, kept = _clipped(ends, windows[np.frombuffer(self._clip, dtype=np.int64)])
        ends, entity = ends[kept], entity[kept]
        present, entity = np.unique(entity, return_inverse=True)
        pens = list(self._pens)
        names = tuple(dict.fromkeys(p.layer for p in pens)) or ("",)
        at = np.array(self._pen, dtype=np.int64)[present] if len(present) else np.zeros(0, dtype=np.int64)
        column = {name: [getattr(p, name) for p in pens] for name in ("width", "colour", "dashed", "filled")}
        layers = np.array([names.index(p.layer) for p in pens], dtype=np.int64)
        kinds = np.array(self._kinds, dtype="<U12")[present] if len(present) else np.zeros(0, dtype="<U12")
        entity = entity.astype(np.int64).reshape(-1)
        arcs = [*self._arcs, *_chained_arcs(ends, entity, kinds)]
        return Linework(
            ends=ends,
            entity=entity,
            kind=kinds,
            layer=layers[at] if len(at) else at,
            width=np.array(column["width"], dtype=np.float64)[at],
            colour=np.array(column["colour"], dtype=np.uint32)[at],
            dashed=np.array(column["dashed"], dtype=np.bool_)[at],
            filled=np.array(column["filled"], dtype=np.bool_)[at],
            closed=np.array(self._closed, dtype=np.bool_)[present] if len(present) else np.zeros(0, np.bool_),
            layer_names=names,
            arcs=np.array(arcs, dtype=np.float64).reshape(-1, 5),
            sheet=self.page,
            page_mm_per_unit=page_mm_per_unit,
            findings=self._findings(),
        )

    def _entity_for(self, points: Sequence[Point], *, pen: Pen, kind: str, closed: bool) -> int:
        number = self._pens.setdefault(pen, len(self._pens))
        goes_on = (
            self._last is not None
            and not (kind or closed or pen.filled)
            and self._pen[-1] == number
            and _near(self._last, points[0])
        )
        if goes_on:
            self._kinds[-1] = "polyline"
            return len(self._kinds) - 1
        area = "mask" if pen.is_white else "solid"
        usual = area if pen.filled else "line" if len(points) == 2 else "polyline"
        self._kinds.append(kind or usual)
        self._closed.append(closed)
        self._pen.append(number)
        return len(self._kinds) - 1

    def _findings(self) -> tuple[Finding, ...]:
        if not self.wild:
            return ()
        return (
            Finding(
                "strokes-without-place",
                "warning",
                f"{self.wild} strokes have coordinates that are no finite numbers, or that lie farther than "
                "10 km of paper away; they were left out.",
                {"strokes": self.wild},
            ),
        )


def _is_near(points: Sequence[Point]) -> bool:
    """Return whether all coordinates are numbers that lie within what is taken."""
    flat = list(itertools.chain.from_iterable(points))
    return not math.isnan(sum(flat)) and max(map(abs, flat)) < _FARTHEST


def _near(a: Point, b: Point) -> bool:
    return abs(a[0] - b[0]) <= _SAME and abs(a[1] - b[1]) <= _SAME


def _clipped(
    ends: NDArray[np.float64], windows: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return (S, 2, 2) segments cut to their (S, 4) windows, and which are left (Liang and Barsky)."""
    start, step = ends[:, 0], ends[:, 1] - ends[:, 0]
    low, high = np.zeros(len(ends)), np.ones(len(ends))
    outside = np.zeros(len(ends), dtype=np.bool_)
    for axis in (0, 1):
        for sign, edge in ((-1.0, windows[:, axis]), (1.0, windows[:, axis + 2])):
            p = sign * step[:, axis]
            q = sign * (edge - start[:, axis])
            outside |= (p == 0) & (q < 0)
            t = np.divide(q, p, out=np.zeros_like(q), where=p != 0)
            low = np.where(p < 0, np.maximum(low, t), low)
            high = np.where(p > 0, np.minimum(high, t), high)
    cut = np.stack([start + step * low[:, None], start + step * high[:, None]], axis=1)
    cut[low == 0, 0] = ends[low == 0, 0]
    cut[high == 1, 1] = ends[high == 1, 1]
    kept = ~outside & (low <= high) & (cut[:, 0] != cut[:, 1]).any(axis=1)
    return cut, np.asarray(kept, dtype=np.bool_)


def _chained_arcs(ends: NDArray[np.float64], entity: NDArray[np.int64], kinds: NDArray[np.str_]) -> list[Arc]:
    """Return the arcs among polylines that were written as many short lines."""
    arcs = []
    count = np.bincount(entity, minlength=len(kinds))
    first = np.cumsum(count) - count
    for i in np.flatnonzero((count >= 4) & (kinds == "polyline")):
        chain = ends[first[i] : first[i] + count[i]]
        if np.abs(chain[1:, 0] - chain[:-1, 1]).max() > _SAME:
            continue
        arc = arc_of(np.vstack([chain[:, 0], chain[-1:, 1]]))
        if arc is not None:
            arcs.append(arc)
    return arcs
