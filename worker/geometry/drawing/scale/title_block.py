"""What the texts of a sheet say of its scale: 1:100, 1/4" = 1'-0", not to scale, all dimensions in mm."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from service.domain.findings import Finding
from worker.geometry.drawing.scale.decision import Witness
from worker.geometry.drawing.scale.dimension_texts import plain

_INCH_M = 0.0254
_LEAST_DPI, _MOST_DPI = 100.0, 2400.0
_LONG_SIDE = {"A0": 1.189, "A1": 0.841, "A2": 0.594, "A3": 0.420, "A4": 0.297}
_SAME_SIDE = 0.015

_USUAL_RATIOS = frozenset(
    {
        1,
        2,
        5,
        10,
        15,
        20,
        25,
        30,
        33,
        40,
        50,
        60,
        75,
        80,
        100,
        120,
        125,
        150,
        175,
        200,
        250,
        300,
        350,
        400,
        500,
    }
    | {
        600,
        750,
        800,
        1000,
        1250,
        1500,
        2000,
        2500,
        5000,
        12,
        16,
        24,
        32,
        48,
        64,
        96,
        128,
        192,
        240,
        360,
        384,
        480,
    }
)
_WORDS = (
    r"scales?|scala|sc|massstab|ma[sßB]+stab|mst|m|esc(?:ala)?|[ée]ch(?:elle)?|schaal|skala|mierzowica|podzia[lł]ka"
    r"|m[ée]rit[ée]k|比例尺?|縮尺|尺度|масштаб|м"
)
_RATIO = re.compile(
    rf"(?:^|[^\w.])(?:(?P<word>{_WORDS})\.?\s*[:=]?\s*)?1\s*(?P<mark>[:/])\s*(?P<n>\d{{1,5}})(?![\d./\"'])",
    re.IGNORECASE,
)
_ARCHITECT = re.compile(
    r"(?:(?P<whole>\d{1,2})[- ]+)?(?P<over>\d{1,2})(?:/(?P<under>2|4|8|16|32))?\s*(?:\"|''|in\.?)\s*=\s*"
    r"(?P<feet>\d{1,4})\s*(?:'|ft\.?)[- ]*(?P<inch>\d{1,2})?",
    re.IGNORECASE,
)
_SHEET = re.compile(r"(?:@|\bauf|\bon|\bat|\bin|\()\s*(?:ISO|DIN)?\s*-?(A[0-4])\b", re.IGNORECASE)
_NOT_TO_SCALE = re.compile(
    r"\bn\.?\s?t\.?\s?s\.?(?![\w])|\bnot\s*(?:drawn\s*)?to\s*(?:any\s*)?scale|\bdo\s*not\s*scale|no\s*scale\b"
    r"|\bnot\s*in\s*scale|unma[sßB]+st[aä]e?blich|nicht\s*ma[sßB]+st[aä]|ohne\s*ma[sßB]+stab"
    r"|hors\s*[ée]chelle|sans\s*[ée]chelle|pas\s*[àa]\s*l'?[ée]chelle|fuori\s*scala|non\s*in\s*scala"
    r"|sin\s*escala|sem\s*escala|fuera\s*de\s*escala|niet\s*op\s*schaal|ej\s*skalenlig|bez\s*skali"
    r"|尺寸不[准準]|不按比例|非比例|未按比例|無縮尺|縮尺なし|ノンスケール|ノースケール|縮尺不同",
    re.IGNORECASE,
)  # fmt: skip
_AS_SHOWN = re.compile(r"do\s*not\s*scale", re.IGNORECASE)
_UNITS = {
    "mm": re.compile(
        r"(?:\b|sions?\s*)(?:in|unit[s:]?|en|em)\s*:?\s*(?:mm|milli?m[eè]t)|单位\s*:?\s*(?:mm|毫米)|単位\s*:?\s*mm",
        re.IGNORECASE,
    ),
    "cm": re.compile(
        r"(?:\b|sions?\s*)(?:in|units?|en|em)\s*:?\s*(?:cm|centim[eè]t|zentimeter)|单位\s*:?\s*(?:cm|厘米)",
        re.IGNORECASE,
    ),
}


@dataclass(frozen=True)
class StatedScale:
    """Hold a scale as the sheet states it in words.

    Parameters
    ----------
    ratio : float
        1:`ratio` on paper.
    text : str
        As it is written.
    sheet : str
        The paper size that the statement is for, such as ``A1``; empty where it names none.
    certain : bool
        Whether a word such as ``scale`` stands with it, or it has the form of an architect's scale.
    """

    ratio: float
    text: str
    sheet: str = ""
    certain: bool = True


def stated_scales(texts: Iterable[str]) -> tuple[StatedScale, ...]:
    """Return the scales that texts state, each ratio once, those with a word for it first.

    ``1:100``, ``M 1:50``, ``1/100``, ``1/4" = 1'-0"``, ``1" = 20'``, with the words of ten languages. A slope
    (``1:12`` beside a ramp) looks the same: without a word for it, a ratio is not `certain`.
    """
    found: dict[float, StatedScale] = {}
    for raw in texts:
        text = plain(raw)[:200]
        sheet = _SHEET.search(text)
        for ratio, certain in _ratios(text):
            old = found.get(ratio)
            name = sheet[1].upper() if sheet else ""
            if old is None or (certain and not old.certain) or (name and not old.sheet):
                found[ratio] = StatedScale(
                    ratio, raw.strip(), name, certain or (old is not None and old.certain)
                )
    return tuple(sorted(found.values(), key=lambda s: (not s.certain, s.ratio)))


def title_witnesses(
    texts: Sequence[str], *, dpi: float | None, shape: tuple[int, ...]
) -> tuple[list[Witness], list[Finding]]:
    """Return what a title block says of the scale [m a pixel], and a remark where the dpi is missing.

    A stated 72 or 96 dpi is a program's default and not believed. Where the statement names a paper size
    (``1:100 @ A1``), a sheet of that size is a second witness, and one of another size is scaled with it.

    Parameters
    ----------
    texts : sequence of str
        All texts of the sheet.
    dpi : float or None
        Pixels an inch as the file states it.
    shape : tuple of int
        Rows and columns of the sheet [pixels].
    """
    stated = stated_scales(texts)
    if dpi is None or not _LEAST_DPI <= dpi <= _MOST_DPI:
        sure = [s.ratio for s in stated if s.certain]
        if not sure:
            return [], []
        remark = Finding(
            "scale-needs-dpi",
            "info",
            f"The sheet states the scale 1:{sure[0]:g}, but its pixels an inch are not known: give both.",
            {"ratios": sure},
        )
        return [], [remark]
    side = max(shape[:2]) * _INCH_M / dpi
    out = []
    for s in stated:
        value = s.ratio * _INCH_M / dpi
        detail = f"The sheet says {s.text!r} and has {dpi:g} pixels an inch."
        if s.sheet:
            value *= _LONG_SIDE[s.sheet] / side
            same = abs(side / _LONG_SIDE[s.sheet] - 1) <= _SAME_SIDE
            detail += f" It is {side * 1000:.0f} mm long."
            if same:
                out.append(Witness("page-size", value, value, f"The sheet is {s.sheet}, as {s.text!r} says."))
        out.append(Witness("title-block", value, value, detail))
    return out, []


def not_to_scale(texts: Iterable[str]) -> str | None:
    """Return the text that says that the sheet is not to scale, or None."""
    for raw in texts:
        text = plain(raw)[:200]
        if _NOT_TO_SCALE.search(text) and not _AS_SHOWN.search(text):
            return raw.strip()
    return None


def stated_unit(texts: Iterable[str]) -> float | None:
    """Return the unit of bare numbers that a note states (``all dimensions in mm``) [m], or None."""
    said = {name for raw in texts for name, form in _UNITS.items() if form.search(plain(raw)[:200])}
    return {"mm": 0.001, "cm": 0.01}[said.pop()] if len(said) == 1 else None


def _ratios(text: str) -> list[tuple[float, bool]]:
    out = []
    for match in _ARCHITECT.finditer(text):
        under = int(match["under"] or 1)
        inches = int(match["whole"] or 0) + int(match["over"]) / under
        feet = int(match["feet"]) + int(match["inch"] or 0) / 12
        if inches > 0 and feet > 0:
            out.append((round(feet * 12 / inches, 6), True))
    for match in _RATIO.finditer(text):
        ratio = int(match["n"])
        if ratio in _USUAL_RATIOS and (match["mark"] == ":" or match["word"] or ratio >= 50):
            out.append((float(ratio), match["word"] is not None))
    return out
