"""The scale of a drawing as a hypothesis: witnesses, and what they agree on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from service.domain.drawing_reading import DrawingScale, ScaleCandidate, ScaleState, ScaleWitness
from service.domain.findings import Finding
from service.domain.scale_hint import ScaleHint

AGREEMENT = 0.02
"""Two witnesses agree when their values differ by at most this share."""

USUAL_UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254, "ft": 0.3048}
"""Units that buildings are drawn in [m]."""

_STATED = "measured-length"
_EACH_COUNTS = frozenset({"dimension-text", "scale-bar", "given-length", _STATED})
_ENOUGH, _OUTNUMBERED = 2, 3
_MOST_CANDIDATES, _MOST_REMARKS, _MOST_HEARD = 12, 8, 200


@dataclass(frozen=True)
class Witness:
    """Hold one independent hint at the scale.

    Parameters
    ----------
    kind : str
        ``given-length``, ``given-ratio``, ``given-unit`` (a person said it); ``measured-length`` (a person
        wrote it into the file, to scale it by); ``file-unit``, ``page-measure``,
        ``title-block``, ``dimension-text``, ``scale-bar`` (the sheet says it); ``door-arcs``,
        ``wall-spacing``, ``extent`` (buildings are like that).
    low, high : float
        The range that the witness allows [m a pixel or drawing unit]; both the same for an exact statement.
    detail : str
        What was seen, as a sentence for people.
    count : int
        How many observations it rests on.
    """

    kind: str
    low: float
    high: float
    detail: str
    count: int = 1

    @property
    def value(self) -> float:
        """Return the middle of the range, geometrically [m a unit]."""
        return float((self.low * self.high) ** 0.5)

    @property
    def exact(self) -> bool:
        """Return whether the range is narrow enough to name a scale."""
        return self.high <= self.low * (1.0 + AGREEMENT)

    def allows(self, metres_per_unit: float) -> bool:
        """Return whether the witness agrees with a scale, give or take 2 %."""
        return self.low / (1 + AGREEMENT) <= metres_per_unit <= self.high * (1 + AGREEMENT)

    def told(self) -> ScaleWitness:
        """Return the witness as a reading tells it."""
        likely = (self.low, self.high) if self.high > self.low else self.low
        return ScaleWitness(self.kind, likely, self.detail, self.count)


@dataclass(frozen=True)
class Scale:
    """Hold what is known of a drawing's scale, and from whom.

    Parameters
    ----------
    state : str
        ``given`` by a person, ``found`` by at least two witnesses that agree, or ``unknown``.
    metres_per_unit : float or None
        Metres a pixel or drawing unit; None while it is unknown.
    witnesses : tuple of Witness
        Everybody who was heard, those who disagree too.
    candidates : tuple of float
        Scales that some witness names, the best supported first; for a person to choose from.
    """

    state: ScaleState
    metres_per_unit: float | None
    witnesses: tuple[Witness, ...] = ()
    candidates: tuple[float, ...] = ()

    def told(self) -> DrawingScale:
        """Return the scale as a reading tells it."""
        return DrawingScale(
            self.state,
            self.metres_per_unit,
            tuple(w.told() for w in self.witnesses),
            tuple(
                ScaleCandidate(c, tuple(w.kind for w in self.witnesses if w.allows(c)))
                for c in self.candidates
            ),
        )


def given(metres_per_unit: float, witnesses: Sequence[Witness] = ()) -> Scale:
    """Return a scale that a person gave, with whoever else was heard."""
    return Scale("given", metres_per_unit, tuple(witnesses))


def decide(
    witnesses: Sequence[Witness],
    *,
    hint: ScaleHint | None = None,
    units: Sequence[float] = (),
    vetoed: bool = False,
) -> Scale:
    """Return the scale that the witnesses agree on, or `unknown` with ranked candidates: never a guess.

    Parameters
    ----------
    witnesses : sequence of Witness
        Everybody who was heard, in any order; of more than 200 an even selection over their values. Each
        of kind `measured-length`, `dimension-text`, `scale-bar` or `given-length` counts as often as its
        `count` says (so many different dimensions); all others of one kind are one voice, since they repeat
        each other.
    hint : ScaleHint, optional
        What a person said: it wins, and the witnesses are only compared with it (`contradictions`).
    units : sequence of float
        The only scales there can be [m a drawing unit], such as `USUAL_UNITS`: then witnesses that give a
        range count in full. Without them the scale is continuous, and at least two exact witnesses have to
        name it; a range only speaks for or against.
    vetoed : bool, default False
        The sheet says of itself that it is not to scale: nothing is found then.

    Returns
    -------
    Scale
        `found` where at least two voices agree within 2 % and no other camp stands against them: for each
        rival scale, more voices speak for the found one alone than for the rival alone; three times as many
        where the rival has two or more. Where there is a `measured-length`, such alone name scales: one is
        enough, since its writer scaled the file by it, and of several the others speak for one or another.

    Raises
    ------
    InvalidRequest
        If the hint is incomplete or contradictory in itself.
    """
    heard = _heard(witnesses)
    if hint is not None:
        said = given_witnesses(hint)
        return Scale("given", hint.metres_per_px(), said + heard, _ranked(heard, units))
    ranked = _ranked(heard, units)
    if vetoed or not ranked or not _prevails(ranked[0], heard, units):
        return Scale("unknown", None, heard, ranked)
    return Scale("found", ranked[0], heard, ranked)


def given_witnesses(hint: ScaleHint) -> tuple[Witness, ...]:
    """Return what a person said as witnesses: one for each measured length.

    Raises
    ------
    InvalidRequest
        If the hint is incomplete or contradictory in itself.
    """
    value = hint.metres_per_px()
    if hint.metres_per_unit is not None:
        return (Witness("given-unit", value, value, f"A person gave {value:.6g} metres a unit."),)
    if hint.ratio is not None:
        detail = f"A person gave 1:{hint.ratio:g} at {hint.dpi:g} pixels an inch."
        return (Witness("given-ratio", value, value, detail),)
    return tuple(
        Witness(
            "given-length",
            k.length_m / k.length_px,
            k.length_m / k.length_px,
            f"A person measured {k.length_m:g} m over {k.length_px:.1f} pixels or units.",
        )
        for k in hint.lengths
    )


def contradictions(scale: Scale) -> tuple[Finding, ...]:
    """Return a remark for each disagreement among the witnesses of a scale; none where they agree."""
    said = [w for w in scale.witnesses if w.kind.startswith("given-")]
    sheet = [w for w in scale.witnesses if not w.kind.startswith("given-")]
    found = []
    if len(said) > 1:
        low, high = min(w.value for w in said), max(w.value for w in said)
        if high > low * (1 + AGREEMENT):
            found.append(
                Finding(
                    "given-lengths-disagree",
                    "warning",
                    f"The measured lengths differ by {100 * (high / low - 1):.1f} % in the scale they give: "
                    "one of them may be wrong, or the sheet is distorted.",
                    {"metres_per_unit": [w.value for w in said]},
                )
            )
    if scale.metres_per_unit is None:
        return (*found, *_camps(scale))
    against = [w for w in sheet if not w.allows(scale.metres_per_unit)]
    found += [
        _against(scale.metres_per_unit, w, given=scale.state == "given") for w in against[:_MOST_REMARKS]
    ]
    return tuple(found)


def _against(value: float, witness: Witness, *, given: bool) -> Finding:
    whose = "given" if given else "found"
    serious = given and witness.exact
    return Finding(
        "scale-contradicted",
        "warning" if serious else "info",
        f"The scale {whose}, {value:.6g} metres a unit, does not agree with this: {witness.detail}",
        {
            "witness": witness.kind,
            "metres_per_unit_low": witness.low,
            "metres_per_unit_high": witness.high,
            "count": witness.count,
        },
    )


def _camps(scale: Scale) -> list[Finding]:
    strong = [c for c in scale.candidates if _votes(w for w in scale.witnesses if w.allows(c)) >= _ENOUGH]
    if len(strong) < _ENOUGH:
        return []
    names = ", ".join(f"{c:.6g}" for c in strong[:_MOST_REMARKS])
    return [
        Finding(
            "scale-witnesses-disagree",
            "warning",
            f"Witnesses of the scale stand in several camps: {names} metres a unit. Measure one length.",
            {"metres_per_unit": list(strong[:_MOST_REMARKS])},
        )
    ]


def _heard(witnesses: Sequence[Witness]) -> tuple[Witness, ...]:
    """Return the witnesses; of very many the ranges and an even selection of the exact ones."""
    if len(witnesses) <= _MOST_HEARD:
        return tuple(witnesses)
    ranges = [w for w in witnesses if w.kind not in _EACH_COUNTS][:_MOST_HEARD]
    exact = sorted((w for w in witnesses if w.kind in _EACH_COUNTS), key=lambda w: w.value)
    step = max(1, -(-len(exact) // _MOST_HEARD))
    return (*ranges, *exact[step // 2 :: step])


def _votes(witnesses: Iterable[Witness]) -> int:
    """Return how many independent voices the witnesses are."""
    each, kinds = 0, set()
    for witness in witnesses:
        if witness.kind in _EACH_COUNTS:
            each += witness.count
        else:
            kinds.add(witness.kind)
    return each + len(kinds)


def _ranked(witnesses: tuple[Witness, ...], units: Sequence[float]) -> tuple[float, ...]:
    """Return the scales that some witness names, or of `units` those that one allows, best first."""
    if units:
        named = [u for u in units if any(w.allows(u) for w in witnesses)]
    else:
        named = _centres([w for w in _naming(witnesses) if w.exact])
    order = sorted(named, key=lambda c: (-_votes(w for w in witnesses if w.allows(c)), c))
    return tuple(order[:_MOST_CANDIDATES])


def _naming(witnesses: tuple[Witness, ...]) -> tuple[Witness, ...]:
    """Return the witnesses that name scales: lengths that a person wrote into the file, else everybody."""
    return tuple(w for w in witnesses if w.kind == _STATED) or witnesses


def _centres(exact: list[Witness]) -> list[float]:
    """Return the middles of the groups of exact witnesses that agree, the largest group first."""
    centres: list[float] = []
    left = sorted(exact, key=lambda w: w.value)
    while left and len(centres) < _MOST_CANDIDATES:
        groups = [[o for o in left if w.allows(o.value)] for w in left]
        best = max(groups, key=_votes)
        centres.append(_median(best))
        left = [w for w in left if w not in best and not w.allows(centres[-1])]
    return centres


def _median(group: list[Witness]) -> float:
    """Return the median of the values, each as often as its count."""
    ordered = sorted(group, key=lambda w: w.value)
    total = sum(w.count for w in ordered)
    low = high = ordered[-1].value
    passed = 0
    for witness in ordered:
        if passed <= (total - 1) // 2 < passed + witness.count:
            low = witness.value
        if passed <= total // 2 < passed + witness.count:
            high = witness.value
        passed += witness.count
    return low if low == high else float((low * high) ** 0.5)


def _prevails(best: float, witnesses: tuple[Witness, ...], units: Sequence[float]) -> bool:
    """Return whether enough voices name a scale, and no camp stands against it."""
    names = _naming(witnesses)
    stated = any(w.kind == _STATED for w in names)
    if _votes(w for w in names if w.allows(best) and (units or w.exact)) < (1 if stated else _ENOUGH):
        return False
    rivals = list(units) or [w.value for w in names]
    rivals = [r for r in rivals if not best / (1 + AGREEMENT) <= r <= best * (1 + AGREEMENT)]
    for rival in rivals:
        own = _votes(w for w in witnesses if w.allows(best) and not w.allows(rival))
        theirs = _votes(w for w in witnesses if w.allows(rival) and not w.allows(best))
        if own <= theirs or (theirs >= _ENOUGH and own < _OUTNUMBERED * theirs):
            return False
    return True
