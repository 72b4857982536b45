"""The flattened model of a DXF file as linework: styles resolved, strays set aside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from ezdxf.document import Drawing
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex, NotFinite
from service.domain.findings import Finding
from worker.formats.dxf_entities import colour_of_index, has_gaps, width_of_weight
from worker.formats.dxf_parts import Drawn, Part, Style
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.scale.decision import Witness

_ABSURD = 1e12
_FAR = 40.0
_MOST_FAR = 0.02
_LEAST_FAR = 3


def linework_of(
    doc: Drawing, part: Part, *, witnesses: Sequence[Witness], findings: Sequence[Finding], bounds: Bounds
) -> Linework:
    """Return a part as linework: BYLAYER resolved, values that are no numbers and far strays left out.

    Raises
    ------
    DrawingTooComplex
        If it has more strokes or texts than are read.
    NotFinite
        If no stroke has coordinates that are numbers.
    """
    if len(part.ends) > bounds.max_strokes:
        raise DrawingTooComplex(
            f"The drawing has {len(part.ends)} strokes; at most {bounds.max_strokes} are read. Save the one "
            "floor that is needed.",
            max_strokes=bounds.max_strokes,
        )
    part, wild = _finite(part)
    part, strays = _near(part)
    texts = [t for t in part.texts if abs(t.x) < _ABSURD and abs(t.y) < _ABSURD]
    more = []
    if len(texts) > bounds.max_texts:
        more.append(
            _finding("texts-left-out", "Only the first texts were read.", len(texts) - bounds.max_texts)
        )
    if wild:
        message = (
            f"{wild} strokes have coordinates that are no finite numbers, or absurd; they were left out."
        )
        more.append(_finding("strokes-without-place", message, wild))
    if strays:
        message = (
            f"{strays} strokes lie more than {_FAR:g} times as far away as the drawing is large; they were "
            "left out."
        )
        more.append(_finding("strokes-far-away", message, strays))
    return _table(doc, replace(part, texts=texts[: bounds.max_texts]), tuple(witnesses), (*findings, *more))


def _finding(code: str, message: str, count: int) -> Finding:
    return Finding(code, "warning", message, {"strokes": count})


def _finite(part: Part) -> tuple[Part, int]:
    good = np.asarray((np.abs(part.ends) < _ABSURD).all(axis=(1, 2)), dtype=np.bool_)
    if len(good) and not good.any():
        raise NotFinite("No stroke of the drawing has coordinates that are numbers: repair it (AUDIT).")
    arcs = part.arcs[(np.abs(part.arcs) < _ABSURD).all(axis=1)]
    return replace(part, ends=part.ends[good], entity=part.entity[good], arcs=arcs), int((~good).sum())


def _near(part: Part) -> tuple[Part, int]:
    """Return the part without the few entities that lie far from all others, and their strokes' count."""
    count = len(part.drawn)
    if not len(part.ends):
        return part, 0
    present, first = np.unique(part.entity, return_index=True)
    low = np.minimum.reduceat(part.ends.min(axis=1), first)
    high = np.maximum.reduceat(part.ends.max(axis=1), first)
    centre = (low + high) / 2.0
    away = np.abs(centre - np.median(centre, axis=0)).max(axis=1)
    usual = float(np.median(away))
    size = float(np.median((high - low).max(axis=1)))
    far = away > _FAR * max(usual, size)
    if not far.any() or far.sum() > max(_LEAST_FAR, _MOST_FAR * len(present)) or far.sum() * 2 > len(present):
        return part, 0
    bad = np.zeros(count, dtype=np.bool_)
    bad[present[far]] = True
    out = bad[part.entity]
    reach, places = _FAR * max(usual, size), part.ends[~out].reshape(-1, 2)
    box = (places.min(axis=0) - reach, places.max(axis=0) + reach)
    at = np.array([(t.x, t.y) for t in part.texts], dtype=np.float64).reshape(-1, 2)
    texts = [part.texts[k] for k in np.flatnonzero(_inside(at, *box)).tolist()]
    arcs = part.arcs[_inside(part.arcs[:, :2], *box)]
    kept = replace(part, ends=part.ends[~out], entity=part.entity[~out], texts=texts, arcs=arcs)
    return kept, int(out.sum())


def _inside(
    points: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.bool_]:
    return np.asarray(((low <= points) & (points <= high)).all(axis=1), dtype=np.bool_)


def _table(
    doc: Drawing, part: Part, witnesses: tuple[Witness, ...], findings: tuple[Finding, ...]
) -> Linework:
    present, entity = np.unique(part.entity, return_inverse=True)
    drawn = [part.drawn[e] for e in present.tolist()]
    resolve = _Resolver(doc)
    known = {id(d): resolve(d) for d in {id(d): d for d in drawn}.values()}
    styles = [known[id(d)] for d in drawn]
    names = {name: n for n, name in enumerate(dict.fromkeys(s.layer for s in styles))}
    return Linework(
        ends=part.ends,
        entity=entity.reshape(-1).astype(np.int64),
        kind=np.array([d.kind for d in drawn], dtype="<U12"),
        layer=np.array([names[s.layer] for s in styles], dtype=np.int64),
        width=np.array([s.width for s in styles], dtype=np.float64),
        colour=np.array([s.colour for s in styles], dtype=np.uint32),
        dashed=np.array([s.dashed == 1 for s in styles], dtype=np.bool_),
        filled=np.array([d.filled for d in drawn], dtype=np.bool_),
        closed=np.array([d.closed for d in drawn], dtype=np.bool_),
        layer_names=tuple(names),
        texts=tuple(part.texts),
        dimensions=tuple(d for d in part.dimensions if abs(d.start[0]) < _ABSURD),
        arcs=part.arcs,
        witnesses=witnesses,
        findings=findings,
    )


class _Resolver:
    """Resolve what entities leave to their layers."""

    def __init__(self, doc: Drawing) -> None:
        self._layers: dict[str, Style] = {}
        self._known: dict[Style, Style] = {}
        for layer in doc.layers:
            name = str(layer.dxf.name)
            colour = layer.dxf.get("true_color")
            self._layers[name.casefold()] = Style(
                name,
                colour_of_index(abs(int(layer.dxf.get("color", 7)))) if colour is None else int(colour),
                width_of_weight(int(layer.dxf.get("lineweight", -3))),
                int(has_gaps(doc, str(layer.dxf.get("linetype", "CONTINUOUS")))),
            )

    def __call__(self, drawn: Drawn) -> Style:
        style = drawn.style
        if style not in self._known:
            name = style.layer or "0"
            layer = self._layers.get(name.casefold(), Style(name, 0, math.nan, 0))
            self._known[style] = Style(
                layer.layer,
                style.colour if style.colour >= 0 else layer.colour,
                layer.width if style.width in {-1.0, -2.0} else style.width,
                style.dashed if style.dashed >= 0 else layer.dashed,
            )
        return self._known[style]
