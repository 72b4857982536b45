"""What is left over: goods stand on many planes and end below the ceiling; undrawn walls do not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from worker.geometry.registration.measure import Fit
from worker.geometry.registration.undrawn import explained_share_at_top, undrawn_wall_share

Points = NDArray[np.float64]


def strip(*at: tuple[float, float], points: int = 50) -> Points:
    """Return upright strips of points, each above a place on the floor."""
    heights = np.linspace(1.5, 2.4, points)
    return np.vstack([np.column_stack([np.full((points, 2), place), heights]) for place in at])


def level(*degrees: float, points: int = 50) -> Points:
    """Return the normals of as many strips, each towards a heading."""
    angles = np.deg2rad(np.repeat(degrees, points))
    return np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))])


def fit_of(placed: Points, *, on_map: int = 0, upright: bool = True) -> Fit:
    """Return how upright structure lies: its last `on_map` points on the map, the others nowhere."""
    n = len(placed)
    inlier = np.arange(n) >= n - on_map
    return Fit(placed, np.zeros(n), np.zeros((n, 3)), inlier, np.full(n, upright), np.full(n, upright))


@pytest.mark.parametrize(("apart", "share"), [(0.19, 1.0), (0.21, 0.5)])
def test_a_plane_is_20_cm_thick(apart: float, share: float) -> None:
    placed = strip((-apart / 2.0, 0.0), (apart / 2.0, 0.0))
    assert undrawn_wall_share(fit_of(placed), level(0.0, 0.0)) == share


@pytest.mark.parametrize(("off", "share"), [(13.3, 1.0), (14.7, 0.5)])
def test_what_looks_14_degrees_aside_is_of_another_plane(off: float, share: float) -> None:
    placed = strip((0.0, 0.0), (0.0, 0.0))
    assert undrawn_wall_share(fit_of(placed), level(off, -off)) == share


@pytest.mark.parametrize("heading", [35.0, 130.0, 345.0])
def test_a_wall_of_20_m_is_one_plane_at_every_fifth_degree(heading: float) -> None:
    angle = np.deg2rad(heading)
    along = np.linspace(-10.0, 10.0, 40)
    placed = strip(*np.column_stack([-np.sin(angle) * along, np.cos(angle) * along]).tolist(), points=3)
    assert undrawn_wall_share(fit_of(placed), level(*[heading] * 40, points=3)) == 1.0


def test_goods_on_many_planes_are_no_wall() -> None:
    places = [(0.5 * k, 0.0) for k in range(10)]
    assert undrawn_wall_share(fit_of(strip(*places)), level(*[0.0] * 10)) == pytest.approx(0.1)


def test_it_is_the_share_of_all_structure_and_what_is_on_the_map_is_not_left_over() -> None:
    placed, normals = strip((0.0, 0.0), (5.0, 0.0)), level(0.0, 0.0)
    assert undrawn_wall_share(fit_of(placed, on_map=50), normals) == 0.5
    assert undrawn_wall_share(fit_of(placed, on_map=100), normals) == 0.0
    assert undrawn_wall_share(fit_of(placed), np.zeros_like(normals)) == 0.0


@pytest.mark.parametrize(("below", "share"), [(0.38, 0.5), (0.42, 1.0)])
def test_the_top_is_the_uppermost_40_cm(below: float, share: float) -> None:
    heights = np.repeat([3.0 - below, 3.0], 100)
    placed = np.column_stack([np.zeros((200, 2)), heights])
    assert explained_share_at_top(fit_of(placed, on_map=100)) == share


@pytest.mark.parametrize(("at_top", "share"), [(3, 1.0), (1, 3 / 200)])
def test_one_stray_point_in_a_hundred_is_no_top(at_top: int, share: float) -> None:
    placed = np.column_stack([np.zeros((200, 2)), np.repeat([2.5, 3.0], [200 - at_top, at_top])])
    assert explained_share_at_top(fit_of(placed, on_map=3)) == share


def test_without_upright_points_nothing_is_explained_at_the_top() -> None:
    assert explained_share_at_top(fit_of(strip((0.0, 0.0)), on_map=50, upright=False)) == 0.0
