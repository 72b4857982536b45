"""Runs of letters to lines of text: programs write a line in pieces, down to single letters."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from worker.geometry.drawing.text import Text

_CAPITAL = 0.72
_SAME_ANGLE = math.radians(2.0)
_SAME_HEIGHT = 1.3
_SAME_BASELINE = 0.35
_OVERLAP, _WORD_GAP, _LARGEST_GAP = -0.6, 0.22, 1.4


@dataclass(frozen=True)
class TextRun:
    """Hold letters that a file writes in one go.

    Parameters
    ----------
    text : str
        The letters.
    x, y : float
        Where their baseline begins, y up.
    length : float
        How far they run along the baseline.
    size : float
        Size of the font, in the same unit.
    angle : float
        Direction of the baseline [rad], counter-clockwise.
    layer : str
        The file's layer.
    """

    text: str
    x: float
    y: float
    length: float
    size: float
    angle: float = 0.0
    layer: str = ""

    def to_text(self) -> Text:
        """Return the run as a text that stands where its middle is."""
        height = _CAPITAL * self.size
        along, up = self.length / 2, height / 2
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        middle_x, middle_y = self.x + along * cos - up * sin, self.y + along * sin + up * cos
        return Text(self.text.strip(), middle_x, middle_y, height, self.angle, self.layer)


def join_runs(runs: Iterable[TextRun]) -> tuple[Text, ...]:
    """Return lines of text: runs that follow each other on one baseline at one size are joined.

    A gap of a fifth of the font's size or more is a space; one of 1.4 times the size ends the line.
    """
    lines: list[TextRun] = []
    for run in runs:
        joined = _joined(lines[-1], run) if lines else None
        if joined is None:
            lines.append(run)
        else:
            lines[-1] = joined
    return tuple(line.to_text() for line in lines if line.text.strip() and line.size > 0)


def _joined(line: TextRun, run: TextRun) -> TextRun | None:
    """Return both as one line, or None where the run begins another."""
    turn = math.remainder(run.angle - line.angle, math.tau)
    if abs(turn) > _SAME_ANGLE or line.layer != run.layer:
        return None
    if not 1 / _SAME_HEIGHT <= run.size / max(line.size, 1e-12) <= _SAME_HEIGHT:
        return None
    cos, sin = math.cos(line.angle), math.sin(line.angle)
    dx, dy = run.x - line.x, run.y - line.y
    gap = (dx * cos + dy * sin - line.length) / line.size
    aside = abs(dy * cos - dx * sin) / line.size
    if aside > _SAME_BASELINE or not _OVERLAP <= gap <= _LARGEST_GAP:
        return None
    between = " " if gap >= _WORD_GAP and not line.text.endswith(" ") and not run.text.startswith(" ") else ""
    return replace(
        line, text=line.text + between + run.text, length=max(line.length, dx * cos + dy * sin + run.length)
    )
