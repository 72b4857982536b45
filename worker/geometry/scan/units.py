"""What one unit of a scan's file counts: by the height of the room and how far the scan reaches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.domain.scan_options import UNITS
from worker.geometry.scan.choice import Choice
from worker.geometry.scan.levels import Levels

_USUAL = {"m": 0.0, "cm": -2.0, "mm": -2.0, "ft": -4.5}
_HEIGHT = (2.7, 1.5)
_UPWARD = (2.7, 2.2)
_ACROSS = (9.0, 3.0)
_MARGIN = 1.5
_LARGEST, _SMALLEST = 500.0, 0.3


def find_unit(
    points: NDArray[np.float64], levels: Levels, *, stated: float | None = None, stated_by: str = ""
) -> Choice[float]:
    """Return the metres of one unit.

    Parameters
    ----------
    points : ndarray of shape (N, 3), float64
        The scan with z up, in its unit.
    levels : Levels
        Its floor and ceiling, in its unit.
    stated : float, optional
        What the file, or its format, says; believed unless no room at all could be so large or small.
    stated_by : str
        Who says so, for the evidence.

    Notes
    -----
    For m, cm, mm and ft the height of the room (where floor and ceiling were seen; 2.7 m, within a factor of
    1.5), the scan's own height and its reach are compared with those of rooms, as log-normal likelihoods.
    Metres are what most files count: another unit has to be clearly likelier, feet by a room's height.
    """
    low, high = np.percentile(points, [1.0, 99.0], axis=0)
    upward, across = float(high[2] - low[2]), float(max(high[:2] - low[:2]))
    seen = f"The scan reaches {across:.4g} units across and {upward:.4g} up"
    room = "" if levels.height is None else f", floor to ceiling {levels.height:.4g}"
    if stated is not None and _SMALLEST <= across * stated <= 4.0 * _LARGEST:
        return Choice(stated, "stated", (stated_by, f"{seen}{room}."))
    if max(across, upward) <= 0.0:
        return Choice(
            1.0, "assumed", ("The scan has no extent to tell its unit by; most files count metres.",)
        )
    fit = {name: _fit(UNITS[name], upward, across, levels.height) + usual for name, usual in _USUAL.items()}
    if levels.height is None:
        del fit["ft"]
    best, second = sorted(fit, key=lambda name: -fit[name])[:2]
    if best != "m" and fit[best] - fit["m"] < _MARGIN:
        return Choice(1.0, "assumed", (f"{seen}{room}; {best} would fit as well as m.",))
    as_metres = f"{seen}{room}: in {best} that is {across * UNITS[best]:.3g} m across"
    tall = "" if levels.height is None else f" and a room of {levels.height * UNITS[best]:.3g} m"
    return Choice(UNITS[best], "found", (f"{as_metres}{tall}; {second} fits less.",))


def _fit(unit: float, upward: float, across: float, height: float | None) -> float:
    """Return the log-likelihood that a room, as rooms are, has these measures in a unit."""
    total = _likelihood(upward * unit, _UPWARD) + _likelihood(across * unit, _ACROSS)
    return total if height is None else total + _likelihood(height * unit, _HEIGHT)


def _likelihood(measure: float, usual: tuple[float, float]) -> float:
    middle, factor = usual
    return float(-0.5 * (np.log(max(measure, 1e-9) / middle) / np.log(factor)) ** 2)
