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


@dataclass(frozen=True)
class ScaleHint:
    """Hold one way in which a person gave the scale; exactly one of the three is set.

    Parameters
    ----------
    metres_per_unit : float, optional
        Metres per pixel of an image, per unit of a CAD drawing.
    ratio, dpi : float, optional
        1:`ratio` on a sheet of `dpi` pixels an inch.
    known_length : KnownLength, optional
        A measured length.
    """

    metres_per_unit: float | None = None
    ratio: float | None = None
    dpi: float | None = None
    known_length: KnownLength | None = None

    def metres_per_px(self) -> float:
        """Return metres per pixel (or drawing unit).

        Raises
        ------
        InvalidRequest
            If the hint is incomplete, contradictory, or gives no positive finite number.
        """
        ways = [self.metres_per_unit is not None, self.ratio is not None, self.known_length is not None]
        if sum(ways) != 1:
            raise _invalid(
                "Give the scale in exactly one way: metres per unit, a ratio with its dpi, or a known length."
            )
        if self.metres_per_unit is not None:
            value = self.metres_per_unit
        elif self.ratio is not None:
            if self.dpi is None or not self.dpi > 0:
                raise _invalid("A ratio such as 1:100 needs the sheet's dpi (pixels an inch).")
            value = self.ratio * _INCH_M / self.dpi
        else:
            k = self.known_length
            assert k is not None
            px = math.hypot(k.x2 - k.x1, k.y2 - k.y1)
            if not px > 0:
                raise _invalid("The two points of the known length are the same.")
            value = k.length_m / px
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
            k = self.known_length
            out["known_length"] = {"x1": k.x1, "y1": k.y1, "x2": k.x2, "y2": k.y2, "length_m": k.length_m}
        return out

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        """Return the hint that `to_json` wrote."""
        fields = dict(value)
        if isinstance(fields.get("known_length"), dict):
            fields["known_length"] = KnownLength(**fields["known_length"])
        return cls(**fields)


def _invalid(detail: str) -> InvalidRequest:
    return InvalidRequest(detail, errors=[{"pointer": "#/scale", "detail": detail}])
