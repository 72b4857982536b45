"""Longitude and latitude to metres on the spot."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_A, _E2 = 6_378_137.0, 6.694_379_990_141_3e-3


def local_metres(lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (N, 2) positions east and north of the middle of the points [m].

    Parameters
    ----------
    lon_lat : ndarray of shape (N, 2), float64
        WGS 84 [degrees].

    Notes
    -----
    A transverse Mercator projection about the middle, to the second order in the distance: 1 mm over a
    kilometre, for a building site and not for a city.
    """
    middle = (lon_lat.min(axis=0) + lon_lat.max(axis=0)) / 2.0
    d_lon, d_lat = np.deg2rad(lon_lat - middle).T
    lat = np.deg2rad(lon_lat[:, 1])
    halfway = np.deg2rad((lon_lat[:, 1] + middle[1]) / 2.0)
    across = _A / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
    along = _A * (1.0 - _E2) / (1.0 - _E2 * np.sin(halfway) ** 2) ** 1.5
    east = across * np.cos(lat) * d_lon
    north = along * d_lat + across * np.sin(lat) * np.cos(lat) * d_lon**2 / 2.0
    return np.column_stack([east, north])
