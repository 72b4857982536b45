"""The scale of a vector page: what it states, its dimensions and scale bars, and how wide its doors are."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from service.domain.findings import Finding
from service.domain.scale_hint import ScaleHint
from worker.geometry.drawing.linework.linework import Linework
from worker.geometry.drawing.page.spans import StrokeIndex, page_spans
from worker.geometry.drawing.scale.decision import Witness, contradictions, decide
from worker.geometry.drawing.scale.dimension_lines import Span
from worker.geometry.drawing.scale.dimension_texts import parse_measure, plain
from worker.geometry.drawing.scale.dimension_vote import Dimension, dimension_witnesses
from worker.geometry.drawing.scale.sheet_scale import SheetScale
from worker.geometry.drawing.scale.title_block import not_to_scale, stated_unit, title_witnesses
from worker.geometry.drawing.text import Text

RATIOS = (
    1, 2, 5, 10, 20, 25, 30, 33, 40, 50, 60, 75, 80, 100, 125, 150, 200, 250, 300, 400, 500, 600, 750,
    1000, 1250, 1500, 2000, 2500, 5000, 12, 16, 24, 32, 48, 64, 96, 120, 128, 192, 240, 360, 384, 480, 720,
    960, 1200,
)  # fmt: skip
"""Denominators that drawings are printed at: metric, architect's and engineer's scales."""

_DPI, _SAME_SCALE = 1270.0, 1e-3
_MOST_MEASURED, _MOST_LOOKS = 300, 1e8
_DOOR_LOW, _DOOR_HIGH, _LEAST_DOORS = 0.6, 1.3, 3
_QUARTER = (math.radians(70.0), math.radians(100.0))
_SAME_RADIUS = 0.03
_LABEL = re.compile(r"^(?P<number>\d{1,4}(?:[.,]\d{1,2})?)\s*(?P<unit>m|cm|mm|ft|feet|')?\.?$", re.IGNORECASE)
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "feet": 0.3048, "'": 0.3048}
_ROW, _REACH, _FIT, _LEAST_LABELS = 0.5, 60.0, 0.02, 3


def find_page_scale(linework: Linework, *, hint: ScaleHint | None = None) -> SheetScale:
    """Return the scale of a vector page, found where at least two voices agree, else unknown.

    Parameters
    ----------
    linework : Linework
        With its page, texts and arcs; a measure dictionary stands among its witnesses already.
    hint : ScaleHint, optional
        What a person said; of a ratio the dpi is not needed, since the page's size is known.

    Returns
    -------
    SheetScale
        In metres a drawing unit, with a finding for every voice that disagrees.

    Raises
    ------
    InvalidRequest
        If the hint is incomplete or contradictory in itself.

    Notes
    -----
    A page is printed at one of some fifty usual scales, or at that which its own dimensions say (a sheet
    that was fitted to other paper). Doors name no scale by themselves: 0.6 to 1.3 m wide, they tell which of
    these can be.
    """
    written = [t.text for t in linework.texts]
    mm = linework.page_mm_per_unit
    witnesses = [*linework.witnesses, *_bars(linework.texts)]
    findings: list[Finding] = []
    if mm is not None:
        stated, findings = _stated(linework, written, mm)
        witnesses += stated
    exact = [w for w in witnesses if w.exact]
    for w in _dimensions(linework, unit=stated_unit(written)):
        if w.count > 1 or any(w.allows(x.value) for x in exact):  # a lone number may be a room's
            witnesses.append(w)
    units = [ratio * mm / 1000 for ratio in RATIOS] if mm is not None else []
    units += [w.value for w in witnesses if w.exact and units and not _is_usual(w.value, units)]
    witnesses += _doors(linework)
    veto = not_to_scale(written)
    if veto is not None:
        findings.append(_veto(veto))
    if hint is not None and hint.ratio is not None and mm is not None:
        hint = replace(hint, dpi=25.4 / mm)
    scale = decide(witnesses, hint=hint, units=units, vetoed=veto is not None)
    return SheetScale(scale, (), (*findings, *contradictions(scale)))


def _is_usual(value: float, units: Sequence[float]) -> bool:
    return any(abs(value / unit - 1.0) <= _SAME_SCALE for unit in units)


def _stated(linework: Linework, written: Sequence[str], mm: float) -> tuple[list[Witness], list[Finding]]:
    """Return what the title block says [m a drawing unit]."""
    px = _DPI * mm / 25.4
    left, bottom, right, top = linework.sheet or (0.0, 0.0, 0.0, 0.0)
    shape = (round((top - bottom) * px), round((right - left) * px))
    found, findings = title_witnesses(written, dpi=_DPI, shape=shape)
    size = f"{(right - left) * mm:.0f} x {(top - bottom) * mm:.0f} mm"
    told = [w.detail.split(" and has ")[0].rstrip(".") + f" on a page of {size}." for w in found]
    return [
        replace(w, low=w.low * px, high=w.high * px, detail=t if w.kind == "title-block" else w.detail)
        for w, t in zip(found, told, strict=True)
    ], findings


def _dimensions(linework: Linework, *, unit: float | None) -> tuple[Witness, ...]:
    """Return what dimension texts and the lines along them say [m a drawing unit]."""
    measured = [(t, m) for t in linework.texts if (m := parse_measure(t.text)) is not None]
    if not measured or not len(linework.ends):
        return ()
    low, high = linework.ends.reshape(-1, 2).min(axis=0), linework.ends.reshape(-1, 2).max(axis=0)
    extent = float((high - low).max())
    px = _DPI / 25.4 * linework.page_mm_per_unit if linework.page_mm_per_unit else 20_000 / extent
    index = StrokeIndex.of(linework)
    heard = []
    most = min(_MOST_MEASURED, max(20, int(_MOST_LOOKS / len(linework.ends))))
    for text, measure in measured[:most]:
        spans = tuple(Span(s.length * px, s.quality, s.start, s.end) for s in page_spans(index, text))
        heard.append(Dimension(text.text, measure, spans, text.height * px))
    found = dimension_witnesses(heard, unit=unit, extent=extent * px)
    return tuple(
        replace(w, low=w.low * px, high=w.high * px, detail=_in_mm(w.detail, px, linework.page_mm_per_unit))
        for w in found
    )


def _in_mm(detail: str, px: float, mm: float | None) -> str:
    """Return a sentence on pixels as one on the page's own unit."""

    def turned(match: re.Match[str]) -> str:
        values = [f"{float(v) / px * (mm or 1.0):.1f}" for v in re.findall(r"\d+", match[0])]
        return " to ".join(values) + (" mm" if mm is not None else " units")

    return re.sub(r"\d+(?: to \d+)? pixels", turned, detail)


def _bars(texts: Iterable[Text]) -> Iterator[Witness]:
    """Yield the scale bars: rows of numbers that rise from 0 in proportion to their places."""
    labels = []
    for text in texts:
        match = _LABEL.match(plain(text.text))
        if match is not None:
            number = float(match["number"].replace(",", "."))
            labels.append((text, number, _UNITS.get((match["unit"] or "").lower())))
    seen: set[int] = set()
    for zero, value, _ in labels:
        if value == 0 and len(seen) < _LEAST_LABELS * 4:
            witness = _bar([entry for entry in labels if _in_row(zero, entry[0])], zero)
            if witness is not None and (key := round(math.log(witness.value) / 0.01)) not in seen:
                seen.add(key)
                yield witness


def _in_row(zero: Text, other: Text) -> bool:
    cos, sin = math.cos(zero.angle), math.sin(zero.angle)
    dx, dy = other.x - zero.x, other.y - zero.y
    same = abs(dy * cos - dx * sin) <= _ROW * zero.height and abs(other.angle - zero.angle) < 0.03
    return same and 0 <= dx * cos + dy * sin <= _REACH * zero.height


def _bar(row: list[tuple[Text, float, float | None]], zero: Text) -> Witness | None:
    """Return the scale of a row of labels; the unit after a number moves the text's middle, not its place."""
    units = {unit for _, _, unit in row if unit is not None}
    if len(units) != 1 or len(row) < _LEAST_LABELS:
        return None
    cos, sin = math.cos(zero.angle), math.sin(zero.angle)
    at = np.array([(t.x - zero.x) * cos + (t.y - zero.y) * sin for t, _, _ in row])
    value = np.array([v for _, v, _ in row])
    order = np.argsort(at)
    at, value = at[order], value[order]
    if not (np.diff(value) > 0).all() or not at[-1] > 0:
        return None
    slope, shift = np.polyfit(at, value, 1)
    if slope <= 0 or np.abs(slope * at + shift - value).max() > _FIT * value[-1]:
        return None
    metres = float(slope) * next(iter(units))
    names = ", ".join(f"{v:g}" for v in value)
    return Witness("scale-bar", metres * 0.985, metres * 1.015, f"A scale bar with the numbers {names}.")


def _doors(linework: Linework) -> list[Witness]:
    """Return how wide the doors can be, from quarter circles of equal radius: as many as there are radii."""
    if linework.arcs is None or not len(linework.arcs):
        return []
    sweep = np.abs(linework.arcs[:, 4])
    radius = np.sort(linework.arcs[(sweep >= _QUARTER[0]) & (sweep <= _QUARTER[1]), 2])
    best: tuple[int, float] = (0, 0.0)
    for r in radius:
        count = int(((radius >= r) & (radius <= r * (1 + _SAME_RADIUS))).sum())
        best = max(best, (count, float(r)))
    count, r = best
    if count < _LEAST_DOORS:
        return []
    detail = (
        f"{count} quarter circles have a radius of {r:.4g} units: doors are {_DOOR_LOW} to {_DOOR_HIGH} m."
    )
    return [Witness("door-arcs", _DOOR_LOW / r, _DOOR_HIGH / r, detail, count)]


def _veto(text: str) -> Finding:
    return Finding(
        "not-to-scale",
        "warning",
        f"The page says of itself that it is not to scale ({text!r}): measure a length on it yourself.",
        {"text": text},
    )
