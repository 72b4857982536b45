"""The scale of a drawing as a hypothesis: witnesses, and what they agree on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

AGREEMENT = 0.02
"""Two witnesses agree when their values differ by at most this share."""

State = Literal["given", "found", "unknown"]


@dataclass(frozen=True)
class Witness:
    """Hold one independent hint at the scale.

    Parameters
    ----------
    kind : str
        ``given-length``, ``given-ratio``, ``given-unit`` (a person said it); ``file-unit``, ``page-measure``,
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

    def to_json(self) -> dict[str, Any]:
        """Return the witness as a JSON object."""
        return {
            "kind": self.kind,
            "metres_per_unit": [self.low, self.high] if self.high > self.low else self.low,
            "detail": self.detail,
            "count": self.count,
        }


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

    state: State
    metres_per_unit: float | None
    witnesses: tuple[Witness, ...] = ()
    candidates: tuple[float, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the scale as a JSON object."""
        return {
            "state": self.state,
            "metres_per_unit": self.metres_per_unit,
            "witnesses": [w.to_json() for w in self.witnesses],
            "candidates": [
                {"metres_per_unit": c, "witnesses": [w.kind for w in self.witnesses if w.allows(c)]}
                for c in self.candidates
            ],
        }


def given(metres_per_unit: float, witnesses: Sequence[Witness] = ()) -> Scale:
    """Return a scale that a person gave, with whoever else was heard."""
    return Scale("given", metres_per_unit, tuple(witnesses))
