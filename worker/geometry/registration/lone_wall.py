"""Where one wall alone holds a scan in a direction: whether the rest of it would rather lie elsewhere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration import measure
from worker.geometry.registration.faces import Faces
from worker.geometry.registration.neighbours import NeighbourGrid

_BESIDE_POINTS, _BESIDE_FACES = 0.25, 0.2
_FARTHEST, _STEP, _NEAREST = 1.2, 0.03, 0.15
_HERE = 0.045
_REACH, _ON = 0.09, 0.05
_LOW, _BELOW_TOP = 0.3, 0.2  # neither floor nor ceiling
_LEVEL = 0.7


class Slide(NamedTuple):
    """Hold how much more of the rest lies on the map elsewhere along a direction.

    Parameters
    ----------
    gain : float
        The best share that is won, of what lies on the map at the pose; negative where nothing is.
    metres : float
        How far along the direction that is; negative is away from the tablet.
    """

    gain: float
    metres: float


def rather_elsewhere(fit: measure.Fit, normals: NDArray[np.float64], faces: Faces) -> Slide | None:
    """Return the best slide along a direction in which a lone wall holds the scan, that wall left out.

    If such a wall was built elsewhere than drawn, the scan is as far off, and fits it all the same. What
    tells are the ends of other walls, doors in them, and walls so far away that little of them was seen.

    Parameters
    ----------
    fit : Fit
        At the pose.
    normals : ndarray of shape (N, 3), float64
        The scan's own, in frame `map`; zero where it is not flat.
    faces : Faces
        Of the map.

    Returns
    -------
    Slide or None
        None where walls face each other in both directions, or none holds the scan.
    """
    upright = fit.inlier & fit.upright & (np.abs(fit.plane[:, 2]) < measure.UPRIGHT)
    planes = measure.upright_planes(fit, fit.upright, sided=True, least_share=measure.GLIMPSE)
    if not len(planes):
        return None
    middle = fit.placed[upright, :2].mean(axis=0)
    z = fit.placed[:, 2]
    standing = (np.abs(normals[:, 2]) < _LEVEL) & (z > _LOW) & (z < np.percentile(z, 99.0) - _BELOW_TOP)
    points = fit.placed[standing, :2] - middle
    slides = [
        _slide(points, planes[np.abs(planes[:, :2] @ along) > measure.ALIGNED], along, faces, middle)
        for along in measure.open_directions(planes)
    ]
    return max(slides, key=lambda slide: slide.gain, default=None)


def _slide(
    points: NDArray[np.float64],
    lone: NDArray[np.float64],
    along: NDArray[np.float64],
    faces: Faces,
    middle: NDArray[np.float64],
) -> Slide:
    """Return the best slide of (N, 2) points off the lone planes (K, 3) over the faces off them."""
    feet, outward = faces.samples
    feet = feet - middle
    rest = points[~_beside(points, lone, _BESIDE_POINTS)]
    widest = np.abs(points).max(initial=0.0) + _FARTHEST + _REACH
    other = (np.abs(feet) < widest).all(axis=1)
    other &= ~(_beside(feet, lone, _BESIDE_FACES) & (np.abs(outward @ along) > measure.ALIGNED))
    if not len(rest) or not other.any():
        return Slide(0.0, 0.0)
    shifts = np.arange(-_FARTHEST, _FARTHEST + _STEP / 2, _STEP)
    counts = _on_faces(rest, along, shifts, feet[other], outward[other])
    here = int(counts[np.abs(shifts) < _HERE].max())
    counts[np.abs(shifts) < _NEAREST] = 0
    best = int(np.argmax(counts))
    return Slide((int(counts[best]) - here) / max(here, 1), float(shifts[best]))


def _beside(places: NDArray[np.float64], planes: NDArray[np.float64], width: float) -> NDArray[np.bool_]:
    """Return which (N, 2) places lie within a width of one of the planes (K, 3)."""
    return np.asarray((np.abs(places @ planes[:, :2].T - planes[:, 2]) < width).any(axis=1), dtype=np.bool_)


def _on_faces(
    points: NDArray[np.float64],
    along: NDArray[np.float64],
    shifts: NDArray[np.float64],
    feet: NDArray[np.float64],
    outward: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Return how many of the points lie on a face at each shift, (len(shifts),)."""
    placed = (points[None] + shifts[:, None, None] * along).reshape(-1, 2)
    flat = np.zeros((len(placed), 3))
    flat[:, :2] = placed
    _, index = NeighbourGrid.of(np.column_stack([feet, np.zeros(len(feet))])).nearest(flat, reach=_REACH)
    off = np.abs(np.sum((placed - feet[index]) * outward[index], axis=1))
    on = (index >= 0) & (off < _ON)
    return np.asarray(on.reshape(len(shifts), -1).sum(axis=1), dtype=np.int64)
