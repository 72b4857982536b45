"""What a person may say about a scan's file: which way is up, and what its numbers count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from service.domain.errors import InvalidRequest

UP_AXES = ("x", "y", "z", "-x", "-y", "-z")
"""The directions that can be up, in the file's own axes."""

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
"""Metres per unit, by the unit's name."""


@dataclass(frozen=True)
class ScanOptions:
    """Hold what is given about a scan; what is None is found from the file.

    Parameters
    ----------
    up : str, optional
        One of `UP_AXES`.
    metres_per_unit : float, optional
        Metres that one unit of the file's coordinates counts.

    Raises
    ------
    InvalidRequest
        If the axis is none of the six, or the unit lies outside 1e-6 to 1e4 metres.
    """

    up: str | None = None
    metres_per_unit: float | None = None

    def __post_init__(self) -> None:
        if self.up is not None and self.up not in UP_AXES:
            raise InvalidRequest(
                f"The scan's up axis is {self.up!r}; it has to be one of {', '.join(UP_AXES)}."
            )
        if self.metres_per_unit is not None and not 1e-6 <= self.metres_per_unit <= 1e4:
            raise InvalidRequest(
                f"The scan's unit is {self.metres_per_unit} m; it has to lie between 0.000001 and 10000 m."
            )

    @classmethod
    def of(cls, up: str | None = None, unit: str | None = None) -> Self:
        """Return the options for an axis and the name of a unit.

        Raises
        ------
        InvalidRequest
            If either is not known.

        Examples
        --------
        >>> ScanOptions.of("y", "mm").metres_per_unit
        0.001
        """
        if unit is not None and unit not in UNITS:
            raise InvalidRequest(f"The scan's unit is {unit!r}; it has to be one of {', '.join(UNITS)}.")
        return cls(up, None if unit is None else UNITS[unit])
