"""PCL's and Autoware's numbers for how well a placed cloud fits, by their own definitions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from worker.geometry.registration.derivatives import score_points
from worker.geometry.registration.ndt_map import NdtMap


def euclidean_fitness_score(distance: NDArray[np.float64], *, max_distance: float = np.inf) -> float:
    """Return the mean squared distance from each source point to its nearest target point.

    Lower is better and 0 is perfect. The score says nothing about the parts of the target that no
    source point is near, so a small scan in the wrong corner can score well: read it together with
    the overlap, never alone.

    Parameters
    ----------
    distance : ndarray of shape (N,), float64
        From each source point, placed, to the nearest target point [m].
    max_distance : float, default inf
        Source points farther than this from every target point are left out of the mean [m].

    Returns
    -------
    float
        Mean of squared distances [m^2], over the K <= N points kept; ``inf`` when K = 0.

    Raises
    ------
    ValueError
        If `distance` is not (N,), or holds a value that is not finite.

    Notes
    -----
    Same definition as `pcl::Registration::getFitnessScore`, except that PCL compares the *squared*
    distance with the limit and returns the largest double for K = 0. Ito et al. (2023), section 4.2,
    accept a placement at 0.038 m^2 or less.

    Examples
    --------
    >>> round(euclidean_fitness_score(np.array([0.1, 0.1])), 6)
    0.01
    """
    if distance.ndim != 1 or not np.isfinite(distance).all():
        msg = f"distances are (N,) and finite, not {distance.shape}"
        raise ValueError(msg)
    kept = distance[distance <= max_distance]
    return float(np.mean(kept**2)) if len(kept) else float("inf")


def transformation_probability(source: NDArray[np.float64], target: NdtMap) -> float:
    """Return PCL's transformation probability (TP) of a placed cloud: higher is better.

    It depends on the cell size and on how the map was thinned, so TPs of different maps do not compare,
    and a wrong map can have the higher one.

    Parameters
    ----------
    source : ndarray of shape (N, 3), float64
        Points already in the map's frame [m], N >= 1.
    target : NdtMap
        The map.

    Returns
    -------
    float
        NDT score over N. All N points count, also those with no Gaussian near.

    Notes
    -----
    `pcl::NormalDistributionsTransform::getTransformationLikelihood` (1.13; before it,
    ``getTransformationProbability``), with d1 and d2 of equation 6.8 and an outlier ratio of 0.55.
    """
    total, _ = score_points(source, target)
    return float(total.sum() / len(source))


def nearest_voxel_transformation_likelihood(source: NDArray[np.float64], target: NdtMap) -> float:
    """Return Autoware's NVTL of a placed cloud: the mean of each point's best Gaussian; higher is better.

    Points without any Gaussian near are left out of the mean, as Autoware does, so a cloud that hardly
    touches the map can score well.

    Parameters
    ----------
    source : ndarray of shape (N, 3), float64
        Points already in the map's frame [m].
    target : NdtMap
        The map.

    Returns
    -------
    float
        0 when no point has a Gaussian near.
    """
    _, best = score_points(source, target)
    found = best[best > 0.0]
    return float(found.mean()) if len(found) else 0.0
