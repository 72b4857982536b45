"""The scale of a sheet of pixels, from what is written on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.findings import Finding
from service.domain.scale_hint import ScaleHint
from worker.geometry.drawing.raster.sheet import Sheet
from worker.geometry.drawing.scale.bar import bar_witnesses
from worker.geometry.drawing.scale.decision import Witness, contradictions, decide
from worker.geometry.drawing.scale.dimension_lines import find_spans
from worker.geometry.drawing.scale.dimension_texts import parse_measure
from worker.geometry.drawing.scale.dimension_vote import Dimension, dimension_witnesses
from worker.geometry.drawing.scale.sheet_scale import SheetScale
from worker.geometry.drawing.scale.text_lines import InkMap, TextLine, crop_line, find_text_lines, map_ink
from worker.geometry.drawing.scale.title_block import not_to_scale, stated_unit, title_witnesses
from worker.geometry.drawing.text import Text

Recognise = Callable[[Sequence[NDArray[np.uint8]]], list[tuple[str, float]]]
"""Upright grey crops of one line each to text and confidence (0 to 1)."""

Progress = Callable[[str, float], None]

_MOST_READ, _AT_A_TIME, _MOST_MEASURED = 260, 24, 200
_MOST_COLUMNS, _MOST_FLIPPED = 22_000, 24
_BARREN, _FEW = 48, 3
_READ, _SURE_NUMBER, _SET_ASIDE = 0.5, 0.75, 0.8


@dataclass(frozen=True, eq=False)
class _Read:
    """Hold a line of text with what it says."""

    line: TextLine
    text: str
    confidence: float


def find_sheet_scale(
    sheet: Sheet,
    *,
    recognise: Recognise | None,
    hint: ScaleHint | None = None,
    progress: Progress | None = None,
) -> SheetScale:
    """Return the scale of a sheet, found from its texts where at least two of them agree, else unknown.

    Dimension texts are paired with the lines that they stand over, title blocks with the resolution of the
    sheet, the numbers of scale bars with their places. A sheet that calls itself not to scale is believed.

    Parameters
    ----------
    sheet : Sheet
        As it was loaded; its own witnesses are heard too.
    recognise : callable or None
        Reads crops of text; None where no text recognition is installed, which a finding says.
    hint : ScaleHint, optional
        What a person said; it wins, and who on the sheet disagrees becomes a finding.
    progress : callable, optional
        Told the stage ``scale`` and the share done; what it raises ends the work.

    Raises
    ------
    InvalidRequest
        If the hint is contradictory in itself.

    Notes
    -----
    At most 260 lines of text are read, the most regular ones first: about 15 ms each on one core.
    """
    tell = progress or (lambda _stage, _share: None)
    tell("scale", 0.0)
    witnesses, findings = list(sheet.witnesses), []
    written = [t.text for t in sheet.texts]
    read: list[_Read] = []
    if recognise is None:
        findings.append(_not_installed())
    else:
        ink = map_ink(sheet.grey)
        read = _read_texts(ink, recognise, tell)
        written += [r.text for r in read]
        witnesses += _measured(ink, read, unit=stated_unit(written))
        witnesses += bar_witnesses(ink, [(r.line, r.text) for r in read], recognise)
        texts = tuple(_text(r, ink.factor) for r in read if r.confidence >= _SET_ASIDE)
    found, remarks = title_witnesses(written, dpi=sheet.dpi, shape=sheet.grey.shape)
    findings += remarks
    veto = not_to_scale(written)
    if veto is not None:
        findings.append(_veto(veto))
    scale = decide([*witnesses, *found], hint=hint, vetoed=veto is not None)
    findings += contradictions(scale)
    tell("scale", 1.0)
    return SheetScale(scale, texts if read else (), tuple(findings))


def _read_texts(ink: InkMap, recognise: Recognise, tell: Progress) -> list[_Read]:
    """Return the lines of text of a sheet, read; doubtful ones also upside down."""
    lines = sorted(find_text_lines(ink), key=lambda line: _irregularity(ink, line))[:_MOST_READ]
    said: list[tuple[str, float]] = []
    columns = 0
    for start in range(0, len(lines), _AT_A_TIME):
        tell("scale", 0.05 + 0.75 * start / max(len(lines), 1))
        crops = [crop_line(ink, line) for line in lines[start : start + _AT_A_TIME]]
        columns += sum(crop.shape[1] for crop in crops)
        if said and (columns > _MOST_COLUMNS or _only_symbols(said[-_BARREN:])):
            break
        said += recognise(crops)
    lines = lines[: len(said)]
    doubtful = [
        i
        for i, (text, sure) in enumerate(said)
        if sure < _SURE_NUMBER and text and len(lines[i].parts) > 2 and lines[i].width < 8 * lines[i].height
    ][:_MOST_FLIPPED]
    tell("scale", 0.8)
    flipped = recognise([crop_line(ink, lines[i], flipped=True) for i in doubtful])
    for i, other in zip(doubtful, flipped, strict=True):
        if other[1] > max(said[i][1], _SURE_NUMBER):
            said[i] = other
    return [
        _Read(line, text, sure)
        for line, (text, sure) in zip(lines, said, strict=True)
        if text and sure >= _READ
    ]


def _only_symbols(said: list[tuple[str, float]]) -> bool:
    """Return whether so many rows in turn held hardly any text that the rest will be symbols too."""
    return len(said) == _BARREN and sum(sure >= _SET_ASIDE and len(text) > 1 for text, sure in said) < _FEW


def _irregularity(ink: InkMap, line: TextLine) -> float:
    """Return how little a row of letters looks like text: numbers of even height come first."""
    spacing = line.width / (len(line.parts) * line.height)
    across = np.abs((-line.along[1], line.along[0]))
    tall = ink.stats[line.parts, 2:4] @ across / line.height
    uneven = float(np.mean((tall > 0.45) & (tall < 0.8))) if abs(math.sin(2 * line.angle)) < 0.1 else 0.3
    return abs(math.log(max(spacing, 0.05) / 0.7)) + uneven + 0.1 * max(0, len(line.parts) - 12)


def _measured(ink: InkMap, read: list[_Read], *, unit: float | None) -> tuple[Witness, ...]:
    """Return what the dimension texts say [m a pixel of the sheet]."""
    numbers = [(r, m) for r in read if r.confidence >= _SURE_NUMBER and (m := parse_measure(r.text))]
    if not numbers:
        return ()
    letters = np.zeros(len(ink.stats), dtype=np.bool_)
    for r in read:
        if r.confidence >= _SURE_NUMBER:
            letters[r.line.parts] = True
    lines = np.where(letters[ink.labels], np.uint8(0), ink.mask)
    dimensions = [
        Dimension(r.text, m, find_spans(lines, r.line), r.line.height) for r, m in numbers[:_MOST_MEASURED]
    ]
    rows, columns = np.flatnonzero(ink.mask.any(axis=1)), np.flatnonzero(ink.mask.any(axis=0))
    extent = float(max(np.ptp(rows), np.ptp(columns)))
    return tuple(
        Witness(w.kind, w.low / ink.factor, w.high / ink.factor, w.detail, w.count)
        for w in dimension_witnesses(dimensions, unit=unit, extent=extent)
    )


def _text(read: _Read, factor: int) -> Text:
    line, shift = read.line, (factor - 1) / 2
    return Text(
        read.text,
        line.x * factor + shift,
        line.y * factor + shift,
        line.height * factor,
        -line.angle,
        confidence=round(read.confidence, 4),
    )


def _not_installed() -> Finding:
    return Finding(
        "ocr-not-installed",
        "info",
        "Dimension texts and the title block were not read: install groundplan[ocr], or give the scale.",
    )


def _veto(text: str) -> Finding:
    return Finding(
        "not-to-scale",
        "warning",
        f"The sheet says of itself that it is not to scale ({text!r}): measure a length on it yourself.",
        {"text": text},
    )
