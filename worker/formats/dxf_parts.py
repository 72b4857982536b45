"""Entities of a DXF file as arrays: one block definition is flattened once and then placed many times."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from ezdxf.math import Matrix44
from numpy.typing import NDArray

from worker.geometry.drawing.linework.linework import Dimension
from worker.geometry.drawing.text import Text

INHERIT_LAYER = ""
BY_LAYER, BY_BLOCK = -1, -2
"""What an entity in a block leaves to its layer, or to the reference that places the block."""

Point = tuple[float, float]


@dataclass(frozen=True)
class Style:
    """Hold how an entity is drawn, as the file says it: values may be `BY_LAYER` or `BY_BLOCK`.

    Parameters
    ----------
    layer : str
        Name of the layer; `INHERIT_LAYER` for layer 0 inside a block.
    colour : int
        0xRRGGBB.
    width : float
        Width of the pen [mm]; NaN where it is the program's default.
    dashed : int
        1 where the line has gaps.
    """

    layer: str
    colour: int = BY_LAYER
    width: float = BY_LAYER
    dashed: int = BY_LAYER

    def placed_by(self, reference: Style) -> Style:
        """Return the style of an entity of a block that a reference of another style places."""
        return Style(
            reference.layer if self.layer == INHERIT_LAYER else self.layer,
            reference.colour if self.colour == BY_BLOCK else self.colour,
            reference.width if self.width == BY_BLOCK else self.width,
            reference.dashed if self.dashed == BY_BLOCK else self.dashed,
        )


@dataclass(frozen=True)
class Drawn:
    """Hold what an entity is: kind, style, whether it is filled and closed."""

    kind: str
    style: Style
    filled: bool = False
    closed: bool = False


@dataclass(eq=False)
class Part:
    """Hold a flattened block or layout: S segments of E entities, arcs, texts, dimensions.

    Parameters
    ----------
    ends : ndarray of shape (S, 2, 2), float64
        In the block's own coordinates.
    entity : ndarray of shape (S,), int64
        Index into `drawn`.
    drawn : list of Drawn
        One an entity.
    arcs : ndarray of shape (A, 5), float64
        Centre x, y, radius, start and sweep [rad].
    """

    ends: NDArray[np.float64]
    entity: NDArray[np.int64]
    drawn: list[Drawn]
    arcs: NDArray[np.float64]
    texts: list[Text] = field(default_factory=list)
    dimensions: list[Dimension] = field(default_factory=list)

    def placed(self, matrix: Matrix44, style: Style, *, kind: str = "") -> Part:
        """Return the part as a reference places it; with `kind` all its entities become of that kind."""
        m = np.array(list(matrix), dtype=np.float64).reshape(4, 4)
        linear, shift = m[:2, :2], m[3, :2]
        distinct = {id(d): d for d in self.drawn}  # many entities share one
        known = {
            n: replace(d, style=d.style.placed_by(style), kind=kind or d.kind) for n, d in distinct.items()
        }
        drawn = [known[id(d)] for d in self.drawn]
        texts = [_placed_text(t, linear, shift, style.layer) for t in self.texts]
        arcs = self.arcs if kind == "" else self.arcs[:0]
        return Part(
            self.ends @ linear + shift, self.entity, drawn, _placed_arcs(arcs, linear, shift), texts, []
        )


def repeated(part: Part, offsets: NDArray[np.float64]) -> Part:
    """Return a part once at each of (N, 2) offsets."""
    n = len(offsets)
    arcs = np.tile(part.arcs, (n, 1))
    arcs[:, :2] += np.repeat(offsets, len(part.arcs), axis=0)
    return Part(
        np.tile(part.ends, (n, 1, 1)) + np.repeat(offsets, len(part.ends), axis=0)[:, None],
        np.tile(part.entity, n) + np.repeat(np.arange(n) * len(part.drawn), len(part.entity)),
        part.drawn * n,
        arcs,
        [replace(t, x=t.x + float(x), y=t.y + float(y)) for x, y in offsets for t in part.texts],
        [],
    )


class PartBuilder:
    """Collect the entities of one block or layout."""

    def __init__(self) -> None:
        self._ends = array("d")
        self._entity = array("q")
        self._drawn: list[Drawn] = []
        self._arcs: list[tuple[float, float, float, float, float]] = []
        self._parts: list[Part] = []
        self.texts: list[Text] = []
        self.dimensions: list[Dimension] = []

    def add(self, paths: Iterable[Sequence[Point]], drawn: Drawn) -> None:
        """Add an entity of one or several polylines."""
        number = len(self._drawn)
        some = False
        for path in paths:
            for (ax, ay), (bx, by) in itertools.pairwise(path):
                self._ends.extend((ax, ay, bx, by))
                self._entity.append(number)
                some = True
        if some:
            self._drawn.append(drawn)

    def add_arc(self, x: float, y: float, *, radius: float, start: float, sweep: float) -> None:
        """Add a circular arc whose chords are added, too."""
        self._arcs.append((x, y, radius, start, sweep))

    def add_part(self, part: Part) -> None:
        """Add what a reference places."""
        self._parts.append(part)

    def finish(self) -> Part:
        """Return everything as one part."""
        own = Part(
            np.frombuffer(self._ends, dtype=np.float64).reshape(-1, 2, 2).copy(),
            np.frombuffer(self._entity, dtype=np.int64).copy(),
            self._drawn,
            np.array(self._arcs, dtype=np.float64).reshape(-1, 5),
            self.texts,
            self.dimensions,
        )
        return joined([own, *self._parts]) if self._parts else own


def joined(parts: Sequence[Part]) -> Part:
    """Return several parts as one."""
    first = np.cumsum([0, *(len(p.drawn) for p in parts)])
    return Part(
        np.concatenate([p.ends for p in parts]),
        np.concatenate([p.entity + n for p, n in zip(parts, first[:-1], strict=True)]),
        [d for p in parts for d in p.drawn],
        np.concatenate([p.arcs for p in parts]),
        [t for p in parts for t in p.texts],
        [d for p in parts for d in p.dimensions],
    )


def _placed_text(text: Text, linear: NDArray[np.float64], shift: NDArray[np.float64], layer: str) -> Text:
    x, y = np.array([text.x, text.y]) @ linear + shift
    along = np.array([math.cos(text.angle), math.sin(text.angle)]) @ linear
    size = math.sqrt(abs(float(np.linalg.det(linear))))
    return replace(
        text,
        x=float(x),
        y=float(y),
        height=text.height * size,
        angle=math.atan2(along[1], along[0]),
        layer=text.layer or layer,
    )


def _placed_arcs(
    arcs: NDArray[np.float64], linear: NDArray[np.float64], shift: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return arcs where they stay circular; a mirrored one turns the other way."""
    if not len(arcs):
        return arcs
    sx, sy = np.hypot(*linear[0]), np.hypot(*linear[1])
    if not sx > 0 or abs(sx - sy) > 0.02 * sx or abs(float(linear[0] @ linear[1])) > 0.02 * sx * sy:
        return arcs[:0]
    out = arcs.copy()
    out[:, :2] = arcs[:, :2] @ linear + shift
    out[:, 2] = arcs[:, 2] * sx
    begin = np.column_stack([np.cos(arcs[:, 3]), np.sin(arcs[:, 3])]) @ linear
    out[:, 3] = np.arctan2(begin[:, 1], begin[:, 0])
    if np.linalg.det(linear) < 0:
        out[:, 4] = -arcs[:, 4]
    return out
