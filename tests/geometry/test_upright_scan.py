"""Scans made upright: unit, up axis, levels, tilt and outliers of generated rooms and of real ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from service.domain.layer_part import OUTLIER
from service.domain.scan_options import UNITS, ScanOptions
from service.domain.transform import Transform
from tests.geometry.rooms import HEIGHT, a_case
from worker.formats.scan import read_upright_scan
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.registration.place import place_scan
from worker.geometry.registration.place_upright import place_upright_scan
from worker.geometry.scan.file_scan import FileScan, Statement
from worker.geometry.scan.mesh_sampling import Mesh, sample_mesh
from worker.geometry.scan.up_axis import turn_upright
from worker.geometry.scan.upright import UprightScan, make_upright


def room(seed: int) -> NDArray[np.float64]:
    """Return a furnished room of 6 m by 4.4 m by 2.6 m, turned about z, its floor at -1.4 m, with noise."""
    rng = np.random.default_rng(seed)
    size = np.array([6.0, 4.4, 2.6])
    faces = []
    for axis in range(3):
        for side in (0.0, 1.0):
            others = [a for a in range(3) if a != axis]
            face = rng.uniform(0.0, 1.0, (int(250 * size[others[0]] * size[others[1]]), 3))
            face[:, axis] = side
            faces.append(face * size)
    table = rng.uniform((1.0, 1.0, 0.75), (2.6, 1.8, 0.75), (600, 3))
    points = np.vstack([*faces, table]) + rng.normal(0.0, 0.005, (sum(map(len, faces)) + 600, 3))
    turned: NDArray[np.float64] = Transform.from_xyz_yaw(0.0, 0.0, -1.4, 0.6 + seed).apply(
        points - [2.0, 2.0, 0.0]
    )
    return turned


def as_file(
    points: NDArray[np.float64], *, up: str = "z", unit: str = "m", said: Statement | None = None
) -> FileScan:
    """Return points that are upright and in metres as a file with another axis and unit would hold them."""
    return FileScan(PointCloud.of(points @ turn_upright(up) / UNITS[unit]), "test", said or Statement())


@pytest.mark.parametrize("up", ["z", "y"])
@pytest.mark.parametrize("unit", ["m", "cm", "mm"])
def test_axis_unit_floor_and_ceiling_are_found(up: str, unit: str) -> None:
    points = room(1)
    made = make_upright(as_file(points, up=up, unit=unit))
    assert (made.frame.up.value, made.frame.up.source) == (up, "found")
    assert made.frame.unit.value == UNITS[unit]
    assert made.frame.floor == pytest.approx(-1.4, abs=0.02)
    assert made.frame.ceiling == pytest.approx(1.2, abs=0.02)
    np.testing.assert_allclose(made.cloud.points, points, atol=1e-9)
    np.testing.assert_allclose(made.scan.points, points @ turn_upright(up), atol=1e-9)
    told = made.frame.told().to_json()
    assert told["up"]["value"] == up
    assert told["metres_per_unit"]["evidence"]


def test_a_scan_in_metres_with_z_up_is_left_as_it_is() -> None:
    points = room(2)
    made = make_upright(as_file(points))
    assert made.cloud is made.scan
    np.testing.assert_array_equal(made.scan.points, points)
    np.testing.assert_array_equal(made.frame.T_upright_scan.matrix, np.eye(4))


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_what_is_given_goes_before_what_is_found(up: str) -> None:
    points = room(3)
    made = make_upright(as_file(points, up=up, unit="in"), ScanOptions.of(up, "in"))
    assert made.frame.up.source == made.frame.unit.source == "given"
    np.testing.assert_allclose(made.cloud.points, points, atol=1e-9)


def test_a_statement_is_believed_unless_the_points_deny_it() -> None:
    points = room(3)
    feet = Statement(metres_per_unit=0.3048, said_by="The file says so.")
    said = make_upright(as_file(points, up="y", unit="ft", said=feet))
    assert (said.frame.unit.value, said.frame.unit.source) == (0.3048, "stated")
    denied = make_upright(FileScan(PointCloud.of(points), "test", Statement(up="y", metres_per_unit=1.0)))
    assert (denied.frame.up.value, denied.frame.up.source) == ("z", "found")


def test_a_tilted_scan_is_levelled_and_its_tilt_told() -> None:
    points = room(5)
    tilt = Transform.from_xyz_rpy((0.0, 0.0, 0.0), np.deg2rad((5.0, -3.0, 0.0)))
    made = make_upright(as_file(tilt.apply(points)))
    assert made.frame.levelled
    assert np.rad2deg(made.frame.tilt) == pytest.approx(np.hypot(5.0, 3.0), abs=0.1)
    back = made.frame.T_upright_scan @ tilt
    assert np.rad2deg(np.arccos(back.rotation[2, 2])) < 0.1
    assert made.frame.floor == pytest.approx(-1.4, abs=0.02)
    assert "scan-levelled" in {finding.code for finding in made.findings()}


def test_points_that_stand_alone_are_told() -> None:
    points = room(6)
    far = np.array([[9.0, 9.0, 4.0], [-8.0, 3.0, 1.0], [0.5, 0.2, 9.0]])
    made = make_upright(as_file(np.vstack([points[:100], far, points[100:]])))
    np.testing.assert_array_equal(np.flatnonzero(made.outliers), [100, 101, 102])
    np.testing.assert_array_equal(made.without_outliers.points, points)


def test_a_scan_far_off_its_origin_is_moved_near() -> None:
    points = room(7)
    off = np.array([691_234.5, 5_335_678.25, 512.0])
    made = make_upright(as_file(points + off))
    np.testing.assert_allclose(made.scan.points + made.frame.origin, points + off, atol=1e-6)
    assert np.abs(made.scan.points).max() < 100.0
    assert made.frame.floor == pytest.approx(-1.4 + 512.0 - made.frame.origin[2], abs=0.02)


def test_a_mesh_is_sampled_by_area_whatever_its_triangles() -> None:
    fine = np.array([[x, y, 0.0] for x in np.linspace(0, 1, 21) for y in np.linspace(0, 1, 21)])
    corner = np.array([i * 21 + j for i in range(20) for j in range(20)])
    small = np.vstack(
        [np.stack([corner, corner + 1, corner + 21], 1), np.stack([corner + 1, corner + 22, corner + 21], 1)]
    )
    large = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    mesh = Mesh(np.vstack([fine, large]), np.vstack([small, len(fine) + np.array([[0, 1, 2], [0, 2, 3]])]))
    points = sample_mesh(mesh, count=30_000)
    cells, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=(30, 10), range=((0, 3), (0, 1)))
    np.testing.assert_allclose(cells, 100.0, atol=25.0)
    assert len(sample_mesh(Mesh(large, np.array([[0, 0, 1]])), count=10)) == 0
    with pytest.raises(ValueError, match="outside"):
        Mesh(large, np.array([[0, 1, 4]]))


def test_a_scan_with_y_up_in_millimetres_is_placed_in_the_file_s_own_axes() -> None:
    case = a_case(31)
    rough = Transform.from_xyz_yaw(0.3, -0.2, 0.0, 0.1) @ case.truth
    alone = np.array([[30.0, 30.0, 30.0]])
    upright = make_upright(as_file(np.vstack([case.scan.points, alone]), up="y", unit="mm"))
    assert (upright.frame.up.value, upright.frame.unit.value) == ("y", 0.001)
    placed = place_upright_scan(upright, case.target, initial=rough)
    plain = place_scan(case.scan, case.target, initial=rough)
    on_map = placed.T_map_scan.apply(upright.scan.points)
    np.testing.assert_allclose(on_map[:-1], case.truth.apply(case.scan.points), atol=0.03)
    np.testing.assert_allclose(on_map[:-1], plain.T_map_scan.apply(case.scan.points), atol=1e-3)
    np.testing.assert_allclose(placed.candidates[0].T_map_scan.matrix, placed.T_map_scan.matrix, atol=1e-12)
    assert placed.labels[-1] == OUTLIER
    assert (placed.labels == OUTLIER).sum() == 1


def test_levels_of_a_room_without_a_ceiling() -> None:
    made = make_upright(as_file(a_case(32).scan.points))
    assert made.frame.floor == pytest.approx(-1.4, abs=0.03)
    assert made.frame.ceiling is None or made.frame.ceiling < HEIGHT - 1.4 + 0.05


@pytest.mark.parametrize(
    ("name", "up"),
    [("user_807-60.ply", "y"), ("pix4d_user_470_user.ply", "z"), ("pix4d_database_470_db.ply", "z"),
     ("room_scan1.pcd", "z"), ("room_scan2.pcd", "z")],
)  # fmt: skip
def test_real_scans_are_read_as_they_are(shared_data: Path, name: str, up: str) -> None:
    made: UprightScan = read_upright_scan(shared_data / "scans" / name)
    assert (made.frame.up.value, made.frame.up.source, made.frame.unit.value) == (up, "found", 1.0)
    np.testing.assert_array_equal(made.frame.T_upright_scan.rotation, turn_upright(up))
