"""Which axis of a scan's file is up: by the surfaces that face along it and across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from worker.geometry.scan.choice import Choice
from worker.geometry.scan.surface_sample import SurfaceSample

_ALONG = np.cos(np.deg2rad(12.0))
_ACROSS = np.sin(np.deg2rad(12.0))
_PRIOR = {"x": np.log(0.01), "y": np.log(0.27), "z": np.log(0.72)}
_STATED = 4.0
_LEVEL, _UPRIGHT, _LOW = 1.0, 6.0, 1.0
_FEWEST = 0.005
_CLEAR = 1.0


@dataclass(frozen=True)
class _Axis:
    """Hold what speaks for one axis."""

    name: str
    level: float
    upright: float
    extent: float


def find_up_axis(sample: SurfaceSample, *, stated: str | None = None, stated_by: str = "") -> Choice[str]:
    """Return which of x, y, z (or the stated axis) is up.

    That up is the axis's positive direction is not found but taken for granted, unless the file states
    otherwise: a scan of a ceiling with lamps looks like one of a floor with furniture turned over.

    Parameters
    ----------
    sample : SurfaceSample
        The scan's surfaces.
    stated : str, optional
        The axis that the file, or its format, says is up.
    stated_by : str
        Who says so, for the evidence.

    Notes
    -----
    Floors, ceilings and table tops face along gravity, walls across it, whichever way the walls run. Three
    measures are added as log-likelihoods to what is usual (z, then y as in ARKit): the share of flat places
    that face along the axis, the share that face along *or* across it, and how low the scan is that way.
    A statement of the file is believed unless these speak strongly against it; where they hardly tell two
    axes apart, z is kept.
    """
    if not sample.enough:
        if stated is not None:
            return Choice(stated, "stated", (stated_by,))
        return Choice("z", "assumed", ("Too few flat places to tell; z is up in most point clouds.",))
    axes = _measure(sample)
    weight = {axis.name: _weight(axis, axes) + _PRIOR[axis.name] for axis in axes}
    if stated is not None:
        weight = {name: value - _PRIOR[name] for name, value in weight.items()}
        weight[stated.strip("-")] += _STATED
    best, second = sorted(weight, key=lambda name: -weight[name])[:2]
    evidence = tuple(
        f"{axis.name}: {axis.level:.0%} of the flat places face along it, {axis.upright:.0%} across it; the "
        f"scan reaches over {axis.extent:.4g} units that way."
        for axis in axes
    )
    if stated is not None and best == stated.strip("-"):
        return Choice(stated, "stated", (stated_by, *evidence))
    if weight[best] - weight[second] < _CLEAR:
        usual = "z" if "z" in {best, second} else best
        unsure = f"{best} and {second} are nearly as likely; give the axis if {usual} is wrong."
        return Choice(usual, "assumed", (unsure, *evidence))
    return Choice(best, "found", evidence)


def turn_upright(up: str) -> NDArray[np.float64]:
    """Return the (3, 3) rotation that takes the axis `up` ("x", "-y", ...) to z.

    Axes that stay level keep their order as far as a rotation can: y up becomes (x, -z, y).
    """
    sign = -1.0 if up.startswith("-") else 1.0
    turns = {
        "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
        "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
        "z": np.eye(3),
    }
    over = np.diag([1.0, sign, sign])
    return np.asarray(over @ turns[up.strip("-")], dtype=np.float64)


def _measure(sample: SurfaceSample) -> list[_Axis]:
    facing = np.abs(sample.normals[sample.flat])
    low, high = np.percentile(sample.points, [2.0, 98.0], axis=0)
    return [
        _Axis(
            name,
            float((facing[:, a] > _ALONG).mean()),
            float((facing[:, a] < _ACROSS).mean()),
            float(high[a] - low[a]),
        )
        for a, name in enumerate("xyz")
    ]


def _weight(axis: _Axis, axes: list[_Axis]) -> float:
    others = [other.extent for other in axes if other is not axis]
    width = float(np.sqrt(others[0] * others[1]))
    low = np.log(max(width, 1e-9) / max(axis.extent, 1e-3 * max(width, 1e-9)))
    return float(
        _LEVEL * np.log(max(axis.level, _FEWEST))
        + _UPRIGHT * np.log(max(axis.level + axis.upright, _FEWEST))
        + _LOW * np.clip(low, -1.0, 1.0)
    )
