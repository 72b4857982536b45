"""Entities of a DXF file as arrays: one block definition is flattened once and then placed many times."""

from __future__ import annotations

import itertools
import math
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from ezdxf.entities.insert import Insert
from ezdxf.math import Matrix44, Vec3
from numpy.typing import NDArray

from service.domain.errors import DrawingTooComplex
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


@dataclass(frozen=True, eq=False)
class Reference:
    """Hold what places a part, M times: by (M, 2, 2) linear maps of rows, then (M, 2) shifts.

    With `kind` all its entities become of that kind, and its arcs are left out.
    """

    part: Part
    linear: NDArray[np.float64]
    shift: NDArray[np.float64]
    style: Style
    kind: str = ""

    @classmethod
    def of(
        cls,
        part: Part,
        matrix: Matrix44,
        style: Style,
        *,
        at: NDArray[np.float64] | None = None,
        kind: str = "",
    ) -> Reference:
        """Return the reference that places a part by a matrix, at each of (M, 2) offsets from there."""
        m = np.array(list(matrix), dtype=np.float64).reshape(4, 4)
        shift = m[3, :2] + (np.zeros((1, 2)) if at is None else at)
        return cls(part, np.broadcast_to(m[:2, :2], (len(shift), 2, 2)), shift, style, kind)

    @property
    def strokes(self) -> int:
        """Return to how many segments it comes."""
        return len(self.part.ends) * len(self.shift)


class PartBuilder:
    """Collect the entities of one block or layout.

    Parameters
    ----------
    most : int
        Segments that it takes at most.
    """

    def __init__(self, *, most: int) -> None:
        self._most = self._left = most
        self._points = array("d")
        self._size = array("q")
        self._entity = array("q")
        self._drawn: list[Drawn] = []
        self._arcs = array("d")
        self._references: list[Reference] = []
        self.texts: list[Text] = []
        self.dimensions: list[Dimension] = []

    def add(self, paths: Iterable[Sequence[Point] | NDArray[np.float64]], drawn: Drawn) -> None:
        """Add an entity of one or several polylines.

        Raises
        ------
        DrawingTooComplex
            If there are more segments than are taken.
        """
        number = len(self._drawn)
        some = False
        for path in paths:
            if len(path) < 2:
                continue
            self._expect(len(path) - 1)
            if isinstance(path, np.ndarray):
                self._points.frombytes(path.astype(np.float64).tobytes())
            else:
                self._points.extend(itertools.chain.from_iterable(path))
            self._size.append(len(path))
            self._entity.append(number)
            some = True
        if some:
            self._drawn.append(drawn)

    def add_arcs(self, arcs: NDArray[np.float64]) -> None:
        """Add (A, 5) circular arcs, as those of a `Part`, whose chords are added, too."""
        self._arcs.frombytes(arcs.astype(np.float64).tobytes())

    def add_reference(self, reference: Reference) -> None:
        """Add what a reference places.

        Raises
        ------
        DrawingTooComplex
            If there are more segments than are taken.
        """
        self._expect(reference.strokes)
        self._references.append(reference)

    def finish(self) -> Part:
        """Return everything as one part: what was added, then what is placed."""
        points = np.frombuffer(self._points, dtype=np.float64).reshape(-1, 2)
        size = np.frombuffer(self._size, dtype=np.int64)
        goes_on = np.ones(len(points), dtype=np.bool_)
        goes_on[np.cumsum(size) - 1] = False
        first = np.flatnonzero(goes_on)
        own = Part(
            np.stack([points[first], points[first + 1]], axis=1),
            np.repeat(np.frombuffer(self._entity, dtype=np.int64), size - 1),
            self._drawn,
            np.frombuffer(self._arcs, dtype=np.float64).reshape(-1, 5).copy(),
            self.texts,
            self.dimensions,
        )
        return joined([own, _placed(self._references)]) if self._references else own

    def _expect(self, count: int) -> None:
        self._left -= count
        if self._left < 0:
            raise DrawingTooComplex(
                f"The drawing has more than {self._most} strokes. Save the one floor that is needed.",
                max_strokes=self._most,
            )


def places_of(insert: Insert) -> NDArray[np.float64]:
    """Return the (N, 2) places of an array of references against its first one, N being its `mcount`."""
    columns, rows = (_steps(insert, "column"), _steps(insert, "row"))
    x, y = (v.ravel() for v in np.meshgrid(columns, rows))
    turn = math.radians(insert.dxf.get("rotation", 0.0))
    ocs = insert.ocs()
    right, up = (ocs.to_wcs(Vec3.from_angle(turn + more)) for more in (0.0, math.pi / 2))
    return np.column_stack([x * right.x + y * up.x, x * right.y + y * up.y])


def _steps(insert: Insert, along: str) -> NDArray[np.float64]:
    """Return where the columns or rows of an array lie; without spacing all are one."""
    spacing = float(insert.dxf.get(f"{along}_spacing", 0.0))
    count = insert.dxf.get(f"{along}_count", 1) if spacing else 1
    return np.arange(max(1, count)) * spacing


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


@np.errstate(invalid="ignore", over="ignore")  # such places are told later
def _placed(references: Sequence[Reference]) -> Part:
    """Return what references place, in their order; all places of one part are computed at once."""
    parts = list({id(r.part): r.part for r in references}.values())
    number = {id(part): n for n, part in enumerate(parts)}
    of = np.repeat([number[id(r.part)] for r in references], [len(r.shift) for r in references])
    linear, shift = (
        np.concatenate([r.linear for r in references]),
        np.concatenate([r.shift for r in references]),
    )
    is_round = np.repeat([not r.kind for r in references], [len(r.shift) for r in references])
    is_round &= _keeps_circles(linear)
    strokes = _begins(np.array([len(p.ends) for p in parts])[of])
    arcs = _begins(np.array([len(p.arcs) for p in parts])[of] * is_round)
    entities = _begins(np.array([len(p.drawn) for p in parts])[of])
    drawn, texts = _drawn_and_texts(references)
    out = Part(
        np.zeros((strokes[-1], 2, 2)), np.zeros(strokes[-1], np.int64), drawn, np.zeros((arcs[-1], 5)), texts
    )
    places = np.split(np.argsort(of, kind="stable"), np.cumsum(np.bincount(of))[:-1])
    for part, here in zip(parts, places, strict=True):
        rows = strokes[here][:, None] + np.arange(len(part.ends))
        out.ends[rows] = _moved(part.ends, linear[here], shift[here])
        out.entity[rows] = part.entity + entities[here][:, None]
        true = here[is_round[here]]
        rows = arcs[true][:, None] + np.arange(len(part.arcs))
        out.arcs[rows] = _moved_arcs(part.arcs, linear[true], shift[true])
    return out


def _begins(count: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return where each of N groups of so many rows begins, and where the last ends."""
    return np.concatenate([[0], np.cumsum(count)]).astype(np.int64)


def _drawn_and_texts(references: Sequence[Reference]) -> tuple[list[Drawn], list[Text]]:
    drawn: list[Drawn] = []
    texts: list[Text] = []
    known: dict[tuple[int, Style, str], list[Drawn]] = {}
    for r in references:
        key = (id(r.part), r.style, r.kind)
        if key not in known:
            distinct = {id(d): d for d in r.part.drawn}  # many entities share one
            styled = {
                n: replace(d, style=d.style.placed_by(r.style), kind=r.kind or d.kind)
                for n, d in distinct.items()
            }
            known[key] = [styled[id(d)] for d in r.part.drawn]
        drawn += known[key] * len(r.shift)
        if r.part.texts:
            linear = r.linear[0].ravel().tolist()
            texts += [
                _placed_text(text, linear, shift, r.style.layer)
                for shift in r.shift.tolist()
                for text in r.part.texts
            ]
    return drawn, texts


def _moved(
    points: NDArray[np.float64], linear: NDArray[np.float64], shift: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (..., 2) points M times, by each linear map and shift."""
    wide = (len(linear), *(1,) * (points.ndim - 1))
    a, b, c, d = (linear[:, i, j].reshape(wide) for i in (0, 1) for j in (0, 1))
    x, y = points[None, ..., 0], points[None, ..., 1]
    return np.stack(
        [x * a + y * c + shift[:, 0].reshape(wide), x * b + y * d + shift[:, 1].reshape(wide)], axis=-1
    )


def _placed_text(text: Text, linear: Sequence[float], shift: Sequence[float], layer: str) -> Text:
    a, b, c, d = linear
    cos, sin = math.cos(text.angle), math.sin(text.angle)
    return replace(
        text,
        x=text.x * a + text.y * c + shift[0],
        y=text.x * b + text.y * d + shift[1],
        height=text.height * math.sqrt(abs(a * d - b * c)),
        angle=math.atan2(cos * b + sin * d, cos * a + sin * c),
        layer=text.layer or layer,
    )


def _keeps_circles(linear: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return by which of (M, 2, 2) linear maps circles stay circles, about."""
    size = np.hypot(linear[:, :, 0], linear[:, :, 1])
    sx, sy = size[:, 0], size[:, 1]
    skew = np.abs((linear[:, 0] * linear[:, 1]).sum(axis=1))
    return np.asarray((sx > 0) & (np.abs(sx - sy) <= 0.02 * sx) & (skew <= 0.02 * sx * sy), dtype=np.bool_)


def _moved_arcs(
    arcs: NDArray[np.float64], linear: NDArray[np.float64], shift: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (A, 5) arcs M times; a mirrored one turns the other way."""
    begin = np.column_stack([np.cos(arcs[:, 3]), np.sin(arcs[:, 3])])
    begin = _moved(begin, linear, np.zeros_like(shift))
    turn = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)[:, None]
    return np.concatenate(
        [
            _moved(arcs[:, :2], linear, shift),
            (arcs[:, 2] * np.hypot(linear[:, 0, 0], linear[:, 0, 1])[:, None])[..., None],
            np.arctan2(begin[..., 1], begin[..., 0])[..., None],
            (arcs[:, 4] * turn)[..., None],
        ],
        axis=-1,
    )
