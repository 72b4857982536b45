"""What a person says about a drawing's scale."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from service.domain.errors import InvalidRequest

_INCH_M = 0.0254


@dataclass(frozen=True)
class KnownLength:
    """Hold two points of the drawing (pixels, y down; or drawing units) and their real distance [m]."""

    x1: float
    y1: float
    x2: float
    y2: float
    length_m: float

    @property
    def length_px(self) -> float:
        """Return the distance of the two points [pixels or drawing units]."""
        return math.hypot(self.x2 - self.x1, self.y2 - self.y1)

    def to_json(self) -> dict[str, float]:
        """Return the length as a JSON object."""
        return {"x1": self.x1, "y1": self.y1, "x2": self.x2, "y2": self.y2, "length_m": self.length_m}


@dataclass(frozen=True)
class ScaleHint:
    """Hold one way in which a person gave the scale; exactly one way is set.

    Parameters
    ----------
    metres_per_unit : float, optional
        Metres per pixel of an image, per unit of a CAD drawing.
    ratio, dpi : float, optional
        1:`ratio` on a sheet of `dpi` pixels an inch.
    known_length : KnownLength, optional
        A measured length.
    known_lengths : tuple of KnownLength
        Several measured lengths: the scale is their least-squares fit.
    """

    metres_per_unit: float | None = None
    ratio: float | None = None
    dpi: float | None = None
    known_length: KnownLength | None = None
    known_lengths: tuple[KnownLength, ...] = ()

    @property
    def lengths(self) -> tuple[KnownLength, ...]:
        """Return the measured lengths, one or several."""
        return self.known_lengths if self.known_length is None else (self.known_length,)

    def metres_per_px(self) -> float:
        """Return metres per pixel (or drawing unit).

        Raises
        ------
        InvalidRequest
            If the hint is incomplete, contradictory, or gives no positive finite number.
        """
        ways = [
            self.metres_per_unit is not None,
            self.ratio is not None,
            self.known_length is not None,
            bool(self.known_lengths),
        ]
        if sum(ways) != 1:
            raise _invalid(
                "Give the scale in exactly one way: metres per unit, a ratio with its dpi, or known lengths."
            )
        if self.metres_per_unit is not None:
            value = self.metres_per_unit
        elif self.ratio is not None:
            if self.dpi is None or not self.dpi > 0:
                raise _invalid("A ratio such as 1:100 needs the sheet's dpi (pixels an inch).")
            value = self.ratio * _INCH_M / self.dpi
        else:
            value = _least_squares(self.lengths)
        if not (math.isfinite(value) and value > 0):
            raise _invalid(f"The scale comes out as {value} metres a pixel; it has to be positive.")
        return value

    def to_json(self) -> dict[str, Any]:
        """Return what was given, as a JSON object."""
        out: dict[str, Any] = {}
        if self.metres_per_unit is not None:
            out["metres_per_unit"] = self.metres_per_unit
        if self.ratio is not None:
            out |= {"ratio": self.ratio, "dpi": self.dpi}
        if self.known_length is not None:
            out["known_length"] = self.known_length.to_json()
        if self.known_lengths:
            out["known_lengths"] = [k.to_json() for k in self.known_lengths]
        return out

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        """Return the hint that `to_json` wrote."""
        fields = dict(value)
        if isinstance(fields.get("known_length"), dict):
            fields["known_length"] = KnownLength(**fields["known_length"])
        if "known_lengths" in fields:
            fields["known_lengths"] = tuple(KnownLength(**k) for k in fields["known_lengths"])
        return cls(**fields)


def _least_squares(lengths: tuple[KnownLength, ...]) -> float:
    """Return the s that makes the sum of (length_m - s * length_px)^2 smallest."""
    for k in lengths:
        if not k.length_px > 0:
            raise _invalid("The two points of a known length are the same.")
        if not (math.isfinite(k.length_m) and k.length_m > 0):
            raise _invalid(f"A known length is positive, not {k.length_m} m.")
    return sum(k.length_m * k.length_px for k in lengths) / sum(k.length_px**2 for k in lengths)


def _invalid(detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": "#/scale", "detail": detail}])
