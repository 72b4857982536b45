"""Graphic scale bars: a row of rising numbers that stand over a bar at places in proportion to them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.drawing.scale.decision import Witness
from worker.geometry.drawing.scale.dimension_texts import plain
from worker.geometry.drawing.scale.text_lines import InkMap, TextLine, crop_line

Recognise = Callable[[Sequence[NDArray[np.uint8]]], list[tuple[str, float]]]

_UNITS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "mètres": 1.0, "metri": 1.0,
    "metros": 1.0, "米": 1.0, "cm": 0.01, "mm": 0.001,
    "ft": 0.3048, "feet": 0.3048, "foot": 0.3048, "'": 0.3048,
}  # fmt: skip
_LABEL = re.compile(r"^(?P<number>\d{1,4}(?:[.,]\d{1,2})?)\s*(?P<unit>[a-zè米]+|')?\.?$", re.IGNORECASE)
_REACH, _ROW = 120.0, 0.6
_LEAST_LABELS, _LEAST_LENGTH, _FIT = 3, 6.0, 0.03
_MOST_ANCHORS, _MOST_SINGLES, _SURE = 12, 24, 0.6
_BAR_SHARE = 0.6


@dataclass(frozen=True)
class _Label:
    """Hold a number of a scale bar: its value, its middle along the row, and its unit [m] if written."""

    value: float
    at: float
    unit: float | None


def bar_witnesses(
    ink: InkMap, read: Sequence[tuple[TextLine, str]], recognise: Recognise
) -> tuple[Witness, ...]:
    """Return one witness for each scale bar of a sheet [m a pixel of the sheet].

    A scale bar is a row of at least three numbers that rise from 0 in proportion to their places, with a
    unit (m, cm, mm, feet) in the row, over or under a bar as long as the row. Grid axes have neither.

    Parameters
    ----------
    ink : InkMap
        The sheet.
    read : sequence of (TextLine, str)
        What was read already; single digits are read here.
    recognise : callable
        Reads crops of text.
    """
    anchors = [line for line, text in read if _is_anchor(text)][:_MOST_ANCHORS]
    out: list[Witness] = []
    for anchor in anchors:
        row = _row(ink, anchor, read, recognise)
        witness = _fit(ink, anchor, row)
        if witness is not None:
            out.append(witness)
    distinct = {round(float(np.log(w.value)) / 0.01): w for w in out}
    return tuple(distinct.values())


def _is_anchor(text: str) -> bool:
    """Return whether a text is a unit, or a number with a unit, and so may end a scale bar."""
    text = plain(text).lower().rstrip(".")
    match = _LABEL.match(text)
    return text in _UNITS or (match is not None and (match["unit"] or "") in _UNITS)


def _row(
    ink: InkMap, anchor: TextLine, read: Sequence[tuple[TextLine, str]], recognise: Recognise
) -> list[_Label]:
    """Return the numbers that stand in one row with an anchor, in reading order."""
    along, across = anchor.along, np.array([-anchor.along[1], anchor.along[0]])
    origin = np.array([anchor.x, anchor.y])
    known: list[tuple[float, float, str]] = []
    taken: set[int] = set()
    for line, text in read:
        offset = np.array([line.x, line.y]) - origin
        if abs(offset @ across) <= _ROW * anchor.height and abs(offset @ along) <= _REACH * anchor.height:
            known.append((float(offset @ along), line.width, text))
            taken.update(int(p) for p in line.parts)
    singles = _singles(ink, anchor, taken)
    for line, (text, sure) in zip(singles, recognise([crop_line(ink, s) for s in singles]), strict=True):
        if sure >= _SURE:
            known.append((float((np.array([line.x, line.y]) - origin) @ along), line.width, text))
    labels = []
    for at, width, raw in sorted(known):
        text = plain(raw).lower()
        match = _LABEL.match({"o": "0", "l": "1", "i": "1"}.get(text, text))
        if match is None:
            if text.rstrip(".") in _UNITS:
                labels.append(_Label(-1.0, at, _UNITS[text.rstrip(".")]))
            continue
        unit = _UNITS.get(match["unit"] or "")
        share = len(match["number"]) / len(text)
        labels.append(_Label(float(match["number"].replace(",", ".")), at - width * (1 - share) / 2, unit))
    return labels


def _singles(ink: InkMap, anchor: TextLine, taken: set[int]) -> list[TextLine]:
    """Return the single letters that stand in one row with an anchor."""
    if abs(np.sin(2 * anchor.angle)) > 0.05:
        return []
    box = ink.stats.astype(np.float64)
    centre = box[:, :2] + box[:, 2:4] / 2 - (anchor.x, anchor.y)
    across = np.array([-anchor.along[1], anchor.along[0]])
    tall = np.abs(box[:, 2:4] @ np.abs(across))
    wide = np.abs(box[:, 2:4] @ np.abs(anchor.along))
    fits = (np.abs(centre @ across) <= _ROW * anchor.height) & (
        np.abs(centre @ anchor.along) <= _REACH * anchor.height
    )
    fits &= (tall >= 0.6 * anchor.height) & (tall <= 1.3 * anchor.height) & (wide <= 1.2 * anchor.height)
    fits[0] = False
    chosen = [int(i) for i in np.flatnonzero(fits) if int(i) not in taken][:_MOST_SINGLES]
    return [
        TextLine(
            anchor.x + float(centre[i, 0]),
            anchor.y + float(centre[i, 1]),
            float(wide[i]) + 1,
            float(tall[i]) + 1,
            anchor.angle,
            np.array([i]),
        )
        for i in chosen
    ]


def _fit(ink: InkMap, anchor: TextLine, row: list[_Label]) -> Witness | None:
    """Return the scale of a row whose numbers rise from 0 in proportion to their places over a bar."""
    units = {label.unit for label in row if label.unit is not None}
    zeros = [i for i, label in enumerate(row) if label.value == 0]
    if len(units) != 1 or not zeros:
        return None
    rising = [row[zeros[-1]]]
    for label in row[zeros[-1] + 1 :]:
        if label.value > rising[-1].value:
            rising.append(label)
    if len(rising) < _LEAST_LABELS:
        return None
    at, value = np.array([r.at for r in rising]), np.array([r.value for r in rising])
    slope, shift = np.polyfit(value, at, 1)
    off = float(np.abs(slope * value + shift - at).max())
    if slope <= 0 or off > _FIT * slope * value[-1]:
        return None
    ends = _bar(ink, anchor, float(shift), float(slope * value[-1] + shift))
    if ends is None:
        return None
    metres = float(value[-1]) * next(iter(units)) / (ends[1] - ends[0]) / ink.factor
    names = ", ".join(f"{v:g}" for v in value)
    return Witness("scale-bar", metres, metres, f"A scale bar with the numbers {names}.")


def _bar(ink: InkMap, anchor: TextLine, low: float, high: float) -> tuple[float, float] | None:
    """Return from where to where a line or bar runs under or over a row of numbers, None without one.

    It has to begin and end within a letter's height of where the numbers say: `low` and `high`, along the row
    from the anchor's middle.
    """
    if high - low < _LEAST_LENGTH * anchor.height:
        return None
    slack = anchor.height
    t = np.arange(low - 2 * slack, high + 2 * slack + 1)
    o = np.arange(-3.0 * anchor.height, 3.0 * anchor.height + 1)
    across = np.array([-anchor.along[1], anchor.along[0]])
    x = np.rint(anchor.x + anchor.along[0] * t[None, :] + across[0] * o[:, None]).astype(int)
    y = np.rint(anchor.y + anchor.along[1] * t[None, :] + across[1] * o[:, None]).astype(int)
    inside = (x >= 0) & (y >= 0) & (x < ink.mask.shape[1]) & (y < ink.mask.shape[0])
    hit = np.zeros(x.shape, dtype=np.bool_)
    hit[inside] = ink.mask[y[inside], x[inside]] > 0
    within = (t >= low) & (t <= high)
    for bar in hit[hit[:, within].mean(axis=1) >= _BAR_SHARE]:
        drawn = t[bar]
        if abs(drawn[0] - low) <= slack and abs(drawn[-1] - high) <= slack:
            return float(drawn[0]), float(drawn[-1])
    return None
