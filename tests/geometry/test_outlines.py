"""Walls and columns of solid outlines, cuts through meshes, chains of segments, positions on the globe."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from worker.geometry.drawing.model.chains import chain_lines
from worker.geometry.drawing.model.geodesy import local_metres
from worker.geometry.drawing.model.mesh_cut import cut_mesh
from worker.geometry.drawing.model.sections import area_of, signed_area
from worker.geometry.drawing.outline.solids import read_outlines


def test_a_rectangle_is_a_wall() -> None:
    solids = read_outlines([shapely.box(0, 0, 5, 0.2)])
    assert len(solids.walls) == 1
    wall = solids.walls[0]
    assert wall.thickness == pytest.approx(0.2)
    assert sorted(wall.centre[:, 0]) == pytest.approx([0.0, 5.0])
    assert wall.centre[:, 1] == pytest.approx([0.1, 0.1])
    left = wall.faces[0][0] - wall.centre[0]
    along = wall.centre[1] - wall.centre[0]
    assert along[0] * left[1] - along[1] * left[0] > 0.0  # the first face lies to the left


def test_the_faces_of_a_corner_are_its_outline() -> None:
    solids = read_outlines([shapely.box(0, 0, 5, 0.2), shapely.box(0, 0, 0.3, 4)])
    assert sorted(w.thickness for w in solids.walls) == pytest.approx([0.2, 0.3])
    ends = {tuple(np.round(w.centre[np.argmin(np.abs(w.centre).sum(axis=1))], 6)) for w in solids.walls}
    assert ends == {(0.15, 0.1)}  # both centre lines meet in the middle of the corner
    faces = shapely.MultiLineString([f for w in solids.walls for f in w.faces])
    outline = shapely.union_all([shapely.box(0, 0, 5, 0.2), shapely.box(0, 0, 0.3, 4)]).exterior
    caps = shapely.MultiLineString([[(5, 0), (5, 0.2)], [(0, 4), (0.3, 4)]])
    assert shapely.hausdorff_distance(faces, outline) < 0.16
    assert shapely.difference(outline, shapely.buffer(shapely.union(faces, caps), 1e-3)).length == 0.0


def test_a_face_is_open_where_another_wall_joins() -> None:
    solids = read_outlines([shapely.box(0, 0, 5, 0.2), shapely.box(2, 0.2, 2.1, 3)])
    faces = shapely.MultiLineString([f for w in solids.walls for f in w.faces])
    joint = shapely.LineString([(2.01, 0.2), (2.09, 0.2)])
    assert shapely.distance(joint, faces) > 0.005
    assert shapely.difference(shapely.LineString([(0, 0), (5, 0)]), shapely.buffer(faces, 1e-3)).length == 0.0


def test_compact_bodies_are_columns_and_thick_ones_keep_their_faces() -> None:
    solids = read_outlines([shapely.box(0, 0, 0.4, 0.4), shapely.Point(3, 3).buffer(0.3)])
    assert len(solids.columns) == 2
    assert not solids.walls
    core = read_outlines([shapely.box(0, 0, 3, 4)])
    assert sum(w.length for w in core.walls) == pytest.approx(14.0)
    assert {w.thickness for w in core.walls} == {0.0}


def test_nothing_gives_nothing() -> None:
    assert read_outlines([]).walls == ()
    assert read_outlines([shapely.Polygon()]).columns == ()


@settings(max_examples=30, deadline=None)
@given(
    yaw=st.floats(-np.pi, np.pi),
    x=st.floats(-500, 500),
    length=st.floats(1.5, 20),
    thickness=st.floats(0.05, 0.6),
)
def test_moving_the_outline_moves_the_wall(yaw: float, x: float, length: float, thickness: float) -> None:
    box = np.array([(0, 0), (length, 0), (length, thickness), (0, thickness)])
    turn = np.array([(np.cos(yaw), -np.sin(yaw)), (np.sin(yaw), np.cos(yaw))])
    solids = read_outlines([shapely.Polygon(box @ turn.T + (x, -x))])
    assert len(solids.walls) == 1
    wall = solids.walls[0]
    assert wall.thickness == pytest.approx(thickness, abs=1e-6)
    ends = np.array([(0, thickness / 2), (length, thickness / 2)]) @ turn.T + (x, -x)
    reached = np.hypot(*(wall.centre[:, None] - ends[None]).T).min(axis=0)
    assert reached.max() < 1e-5


def _box_mesh(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[(low, high)[(i >> k) & 1][k] for k in range(3)] for i in range(8)], dtype=np.float64)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return corners, np.array(faces, dtype=np.int64)


def test_a_box_is_cut_in_its_rectangle_with_the_material_to_the_left() -> None:
    vertices, faces = _box_mesh(np.array([0.0, 0, 0]), np.array([3.0, 2, 1]))
    rings, lines = cut_mesh(vertices, faces, 0.5)
    assert not lines
    assert [signed_area(r) for r in rings] == [pytest.approx(6.0)]
    assert cut_mesh(vertices, faces, 1.5) == ([], [])
    at_its_top, _ = cut_mesh(vertices, faces, 0.0)  # through vertices: raised by micrometres
    assert signed_area(at_its_top[0]) == pytest.approx(6.0, abs=1e-3)


def test_a_mesh_that_shares_no_vertices_is_cut_all_the_same() -> None:
    vertices, faces = _box_mesh(np.array([0.0, 0, 0]), np.array([3.0, 2, 1]))
    rings, lines = cut_mesh(vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3), 0.4)
    assert not lines
    assert area_of(rings).area == pytest.approx(6.0)


def test_an_open_surface_gives_lines() -> None:
    vertices = np.array([(0, 0, 0), (4, 0, 0), (4, 0, 2), (0, 0, 2)], dtype=np.float64)
    rings, lines = cut_mesh(vertices, np.array([(0, 1, 2), (0, 2, 3)]), 1.0)
    assert not rings
    assert len(lines) == 1
    assert np.ptp(lines[0], axis=0) == pytest.approx([4.0, 0.0])


def test_holes_are_no_material() -> None:
    outer = np.array([(0, 0), (4, 0), (4, 4), (0, 4)], dtype=np.float64)
    hole = np.array([(1, 1), (1, 3), (3, 3), (3, 1)], dtype=np.float64)
    assert area_of([outer, hole]).area == pytest.approx(12.0)
    assert area_of([outer, hole[::-1]]).area == pytest.approx(16.0)  # a body in a body
    assert area_of([]).is_empty


def test_edges_run_on_through_vertices_of_two() -> None:
    vertices = np.array([(0, 0), (1, 0), (2, 0), (2, 1), (2, -1), (9, 9)], dtype=np.float64)
    edges = np.array([(0, 1), (1, 2), (2, 3), (2, 4), (5, 5), (1, 0)])
    lines = chain_lines(vertices, edges)
    assert sorted(len(line) for line in lines) == [2, 2, 3]
    ring = chain_lines(vertices[:4], np.array([(0, 1), (1, 2), (2, 3), (3, 0)]))
    assert len(ring) == 1
    assert np.array_equal(ring[0][0], ring[0][-1])


def test_positions_on_the_globe_are_metres_on_the_spot() -> None:
    lon, lat = 13.4, 52.5
    here = np.array([(lon, lat), (lon + 0.002, lat), (lon, lat + 0.002), (lon + 0.002, lat + 0.002)])
    xy = local_metres(here)
    # Lengths of an arc of parallel and of meridian by the series of the WGS 84 ellipsoid.
    phi = np.deg2rad(lat)
    east = 0.002 * (111_412.84 * np.cos(phi) - 93.5 * np.cos(3 * phi) + 0.118 * np.cos(5 * phi))
    north = 0.002 * (111_132.92 - 559.82 * np.cos(2 * phi) + 1.175 * np.cos(4 * phi))
    assert xy[1, 0] - xy[0, 0] == pytest.approx(east, abs=2e-3)
    assert xy[2, 1] - xy[0, 1] == pytest.approx(north, abs=2e-3)
    assert np.abs(xy.mean(axis=0)).max() < 0.01
