"""Dimension texts and their lines to one scale: a vote that chance cannot win."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from worker.geometry.drawing.scale.decision import AGREEMENT, Witness
from worker.geometry.drawing.scale.dimension_lines import Span
from worker.geometry.drawing.scale.dimension_texts import Measure

MILLIMETRE, CENTIMETRE = 0.001, 0.01

_TOLERANCE, _PIXELS = 0.004, 2.0
_SAME_LENGTH = 0.05
_LOG_RANGE, _BY_CHANCE = 3.0, 0.02
_SURE, _MOST_OTHERS = 0.5, 8
_LETTER_LOW, _LETTER_HIGH = 0.02, 1.5
_LEAST_LETTER_IN_CENTIMETRES = 0.1
_EXTENT_LOW, _EXTENT_HIGH = 2.0, 1000.0
_USUAL_LETTER, _LETTER_SPREAD = 0.2, 0.6
_USUAL_LENGTH, _LENGTH_SPREAD = 4.0, 1.0
_USUAL_EXTENT, _EXTENT_SPREAD = 25.0, 1.0
_TELLS_APART = {MILLIMETRE: 3.0, CENTIMETRE: 5.0}


@dataclass(frozen=True)
class Dimension:
    """Hold a text that names a length, and the stretches of lines that it may be the length of.

    Parameters
    ----------
    text : str
        As it was read.
    measure : Measure
        What it says.
    spans : tuple of Span
        The surest first.
    height : float
        Height of the letters, in the same pixels as the spans.
    """

    text: str
    measure: Measure
    spans: tuple[Span, ...]
    height: float

    def metres(self, unit: float) -> float:
        """Return the length [m], a bare integer taken in `unit` [m]."""
        return self.measure.value * (unit if self.measure.form == "integer" else 1.0)


@dataclass(frozen=True)
class Camp:
    """Hold the dimensions that agree on a scale.

    Parameters
    ----------
    metres_per_px : float
        Least squares over the members.
    members : tuple of (Dimension, Span)
        Who agrees, each with the stretch that fits.
    lengths : int
        How many clearly different lengths are among them: equal ones repeat each other.
    weight : float
        Sum of the spans' qualities.
    by_chance : float
        How many camps of so many would come about by chance.
    """

    metres_per_px: float
    members: tuple[tuple[Dimension, Span], ...]
    lengths: int
    weight: float
    by_chance: float


def dimension_witnesses(
    dimensions: Sequence[Dimension], *, unit: float | None = None, extent: float | None = None
) -> tuple[Witness, ...]:
    """Return what the dimension texts of a sheet say of its scale [m a pixel].

    The first witness is the largest group that agrees, counted by its clearly different lengths. A group
    that chance could explain, or whose letters or building would be of an impossible size, counts once.
    Bare integers are millimetres or centimetres; where the size of the letters does not tell which, both
    are said, and nobody wins.

    Parameters
    ----------
    dimensions : sequence of Dimension
        Those without spans are left out.
    unit : float, optional
        What a note on the sheet says the bare integers are in [m].
    extent : float, optional
        The longer side of what is drawn, in the pixels of the spans.
    """
    heard = [d for d in dimensions if d.spans]
    units = [unit] if unit is not None else [MILLIMETRE, CENTIMETRE]
    camps = [(u, camp) for u in units if (camp := largest_camp(heard, unit=u)) is not None]
    if not camps:
        return ()
    most = max(camp.lengths for _, camp in camps)
    camps = _distinct([(u, camp) for u, camp in camps if camp.lengths == most])
    sized = _tell_apart([(u, camp) for u, camp in camps if _plausible(camp, u, extent, stated=unit)], extent)
    out = [_witness(camp, sure=True) for _, camp in sized if camp.by_chance <= _BY_CHANCE]
    out = out or [_witness(camp, sure=False) for _, camp in (sized or camps)]
    unit, camp = (sized or camps)[0]
    inside = {id(d) for d, _ in camp.members}
    rest = [d for d in heard if id(d) not in inside]
    second = largest_camp(rest, unit=unit)
    if (
        second is not None
        and second.by_chance <= _BY_CHANCE
        and not _near(out[0].value, second.metres_per_px)
    ):
        out.append(_witness(second, sure=True))  # a detail at another scale, or somebody is wrong
    return (*out, *_others(rest, unit, out))


def largest_camp(dimensions: Sequence[Dimension], *, unit: float) -> Camp | None:
    """Return the group of dimensions that agree on one scale with the most weight, or None without any."""
    options = [(d, s, d.metres(unit) / s.length) for d in dimensions for s in d.spans]
    if not options:
        return None
    scales = np.log(np.array([value for _, _, value in options]))
    tolerance = np.array([_TOLERANCE + _PIXELS / s.length for _, s, _ in options])
    best: list[int] = []
    weight = 0.0
    for centre in range(len(options)):
        near = np.flatnonzero(np.abs(scales - scales[centre]) <= tolerance + tolerance[centre] / 2)
        members = _one_each(options, near)
        sum_ = sum(options[i][1].quality for i in members)
        if sum_ > weight + 1e-9:
            best, weight = members, sum_
    best = _refined(options, best, scales, tolerance)
    chosen = [(options[i][0], options[i][1]) for i in best]
    value = sum(d.metres(unit) * s.length for d, s in chosen) / sum(s.length**2 for _, s in chosen)
    lengths = _different([s.length for _, s in chosen])
    chance = _chance(
        _statements(dimensions), lengths, len(options) / len(dimensions), float(np.median(tolerance))
    )
    return Camp(value, tuple(chosen), lengths, weight, chance)


def _one_each(options: list[tuple[Dimension, Span, float]], near: np.ndarray) -> list[int]:
    """Return the best option of each dimension among some."""
    best: dict[int, int] = {}
    for i in near:
        key = id(options[i][0])
        if key not in best or options[i][1].quality > options[best[key]][1].quality:
            best[key] = int(i)
    return list(best.values())


def _refined(
    options: list[tuple[Dimension, Span, float]],
    members: list[int],
    scales: np.ndarray,
    tolerance: np.ndarray,
) -> list[int]:
    """Return the members after the middle of the group has settled, weighted by length."""
    for _ in range(2):
        weights = np.array([options[i][1].length * options[i][1].quality for i in members])
        order = np.argsort(scales[members])
        passed = np.cumsum(weights[order])
        middle = scales[members][order][np.searchsorted(passed, passed[-1] / 2)]
        settled = _one_each(options, np.flatnonzero(np.abs(scales - middle) <= tolerance))
        if not settled or settled == members:
            break
        members = settled
    return members


def _different(lengths: list[float]) -> int:
    """Return how many lengths remain when those within 5 % of each other are one."""
    count, last = 0, -math.inf
    for length in sorted(lengths):
        if length > last * (1 + _SAME_LENGTH) or count == 0:
            count, last = count + 1, length
    return count


def _statements(dimensions: Sequence[Dimension]) -> int:
    """Return how many dimensions remain when those of one number over one length are one."""
    count = 0
    last = (-math.inf, -math.inf)
    for said in sorted((math.log(d.measure.value), math.log(d.spans[0].length)) for d in dimensions):
        if max(abs(said[0] - last[0]), abs(said[1] - last[1])) > _SAME_LENGTH:
            count, last = count + 1, said
    return count


def _chance(heard: int, agreeing: int, options: float, tolerance: float) -> float:
    """Return how many groups of `agreeing` among `heard` random dimensions would agree by chance."""
    if agreeing < 2:
        return math.inf
    hit = min(1.0, options * 2 * tolerance / _LOG_RANGE)
    return math.comb(heard, agreeing) * hit ** (agreeing - 1)


def _plausible(camp: Camp, unit: float, extent: float | None, *, stated: float | None) -> bool:
    """Return whether letters and building have a possible size at a camp's scale.

    Bare inches taken for centimetres would make small letters: these are not believed.
    """
    letter = _median_letter(camp)
    guessed = stated is None and any(d.measure.form == "integer" for d, _ in camp.members)
    least = _LEAST_LETTER_IN_CENTIMETRES if guessed and unit == CENTIMETRE else _LETTER_LOW
    if not least <= letter <= _LETTER_HIGH:
        return False
    return extent is None or _EXTENT_LOW <= extent * camp.metres_per_px <= _EXTENT_HIGH


def _median_letter(camp: Camp) -> float:
    return float(np.median([d.height for d, _ in camp.members])) * camp.metres_per_px


def _near(value: float, other: float) -> bool:
    return abs(math.log(value / other)) <= 2 * math.log1p(AGREEMENT)


def _distinct(camps: list[tuple[float, Camp]]) -> list[tuple[float, Camp]]:
    """Return the camps, of those at one scale the largest alone: it is one statement, not two."""
    kept: list[tuple[float, Camp]] = []
    for unit, camp in sorted(camps, key=lambda c: -len(c[1].members)):
        if not any(_near(camp.metres_per_px, other.metres_per_px) for _, other in kept):
            kept.append((unit, camp))
    return kept


def _tell_apart(camps: list[tuple[float, Camp]], extent: float | None) -> list[tuple[float, Camp]]:
    """Return the one of two readings of bare integers that is far more usual, or both."""
    if len(camps) < 2:
        return camps
    ranked = sorted(camps, key=lambda c: -_usual(c[1], c[0], extent))
    ahead = _usual(ranked[0][1], ranked[0][0], extent) - _usual(ranked[1][1], ranked[1][0], extent)
    return ranked[:1] if ahead >= _TELLS_APART[ranked[0][0]] else ranked


def _usual(camp: Camp, unit: float, extent: float | None) -> float:
    """Return the logarithm of how usual sizes are: letters of some 20 cm, lengths of 4 m, plans of 25 m."""
    length = float(np.median([d.metres(unit) for d, _ in camp.members]))
    off = [
        math.log(_median_letter(camp) / _USUAL_LETTER) / _LETTER_SPREAD,
        math.log(length / _USUAL_LENGTH) / _LENGTH_SPREAD,
    ]
    if extent:
        off.append(math.log(extent * camp.metres_per_px / _USUAL_EXTENT) / _EXTENT_SPREAD)
    return -0.5 * sum(o * o for o in off)


def _witness(camp: Camp, *, sure: bool) -> Witness:
    texts = ", ".join(d.text for d, _ in camp.members[:6]) + (", ..." if len(camp.members) > 6 else "")
    lengths = [s.length for _, s in camp.members]
    many = f"{len(camp.members)} dimensions agree" if len(camp.members) > 1 else "A dimension"
    detail = f"{many} ({texts}) over lines of {min(lengths):.0f} to {max(lengths):.0f} pixels."
    if not sure and len(camp.members) > 1:
        detail += " They may agree by chance, repeat one length, or make letters of an odd size."
    return Witness(
        "dimension-text", camp.metres_per_px, camp.metres_per_px, detail, camp.lengths if sure else 1
    )


def _others(rest: Sequence[Dimension], unit: float, said: Sequence[Witness]) -> list[Witness]:
    """Return the sure dimensions that belong to no camp, each scale once and none that was said.

    A camp is far narrower than the agreement of witnesses: a text cut short may come near it, and is no
    second voice.
    """
    out: list[Witness] = []
    for d in rest:
        value = d.metres(unit) / d.spans[0].length
        if d.spans[0].quality < _SURE or any(_near(w.value, value) for w in (*said, *out)):
            continue
        detail = f"The text {d.text} over a line of {d.spans[0].length:.0f} pixels."
        out.append(Witness("dimension-text", value, value, detail))
    return out[:_MOST_OTHERS]
