"""Scans of every kind: points come back as they were, meshes evenly; what lies is refused for what it is."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileMalformed,
    FileTruncated,
    HeaderMismatch,
    InvalidRequest,
    NotFinite,
    Rejected,
    TooManyPoints,
    UnsupportedMedia,
)
from service.domain.scan_options import ScanOptions
from tests.formats import scan_files
from tests.formats.scan_files import BOXES, CLOUDS
from worker.formats.scan import load_scan, read_scan, read_upright_scan
from worker.geometry.cloud.point_cloud import PointCloud

SIZE = np.array([5.0, 4.0, 2.5])
Z_UP = ScanOptions(up="z")


@pytest.mark.parametrize("ending", CLOUDS)
def test_points_come_back_within_float_precision(tmp_path: Path, ending: str) -> None:
    points = scan_files.room_points(1)
    CLOUDS[ending](tmp_path / f"scan.{ending}", points)
    (tmp_path / f"scan.{ending}").rename(tmp_path / "blob")
    surface = load_scan(tmp_path / "blob").surface
    assert isinstance(surface, PointCloud)
    np.testing.assert_allclose(surface.points, points, atol=1e-6, rtol=0)


@pytest.mark.parametrize("ending", BOXES)
def test_a_mesh_gets_points_evenly_by_area(tmp_path: Path, ending: str) -> None:
    BOXES[ending](tmp_path / f"mesh.{ending}", SIZE)
    (tmp_path / f"mesh.{ending}").rename(tmp_path / "blob")
    points = read_scan(tmp_path / "blob", options=Z_UP).points
    np.testing.assert_allclose(points.min(axis=0), 0.0, atol=1e-3)
    np.testing.assert_allclose(points.max(axis=0), SIZE, atol=1e-3)
    areas = np.array([20.0, 20.0, 12.5, 12.5, 10.0, 10.0])
    on = [np.abs(points[:, a] - side * SIZE[a]) < 1e-5 for a in (0, 1, 2) for side in (0.0, 1.0)]
    counts = np.array([m.sum() for m in on])
    np.testing.assert_allclose(counts[[4, 5, 2, 3, 0, 1]] / areas, 2500.0, rtol=0.03)
    floor = points[on[4]][:, :2] / SIZE[:2]
    cells, _, _ = np.histogram2d(floor[:, 0], floor[:, 1], bins=10, range=((0, 1), (0, 1)))
    assert cells.min() > 0.8 * cells.mean()
    assert cells.max() < 1.2 * cells.mean()
    np.testing.assert_array_equal(points, read_scan(tmp_path / "blob", options=Z_UP).points)


def test_what_a_usd_file_says_of_its_axes_and_unit_is_believed(tmp_path: Path) -> None:
    box = np.array([5.0, 2.5, 4.0])
    scan_files.box_usdc(tmp_path / "a.usdc", box, up="z", metres_per_unit=0.001)
    scan_files.box_usdc(tmp_path / "b.usdc", box)
    scan_files.box_usdc(tmp_path / "c.usdc", box, up=None, metres_per_unit=None)
    frames = [read_upright_scan(tmp_path / f"{name}.usdc").frame for name in "abc"]
    assert [(f.up.value, f.up.source) for f in frames[:2]] == [("z", "stated"), ("y", "stated")]
    assert [f.unit.value for f in frames] == [0.001, 0.01, 1.0]
    assert [f.unit.source for f in frames] == ["stated", "stated", "found"]
    assert frames[1].ceiling == pytest.approx(2.5, abs=0.01)


def test_a_table_may_have_its_columns_in_any_order_and_in_millimetres(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("\ufeffz [mm],x [mm],y [mm]\n3000,1000,2000\n6000.5,4000,5000\n")
    scan = load_scan(tmp_path / "a.csv")
    assert scan.statement.metres_per_unit == 0.001
    assert scan.coarse().tolist() == [[1000, 2000, 3000], [4000, 5000, 6000.5]]


def written(
    ending: str, writer: Callable[[Path, np.ndarray], None], points: np.ndarray
) -> Callable[[Path], bytes]:
    def content(folder: Path) -> bytes:
        path = folder / f"good.{ending}"
        writer(path, points)
        return path.read_bytes()

    return content


POINTS = scan_files.room_points(2, count=3_000)
BAD = np.vstack([POINTS[:2_999], [[1.0, np.nan, 0.0]]])
WHOLE = {
    **{ending: written(ending, CLOUDS[ending], POINTS) for ending in CLOUDS},
    **{f"mesh {ending}": written(ending, BOXES[ending], SIZE) for ending in BOXES},
}


@pytest.mark.parametrize(
    "kind", sorted(set(WHOLE) - {"xyz", "csv", "comma.csv", "cc.xyz", "obj", "mesh obj"})
)
@pytest.mark.parametrize("share", [0.5, 0.97])
def test_a_file_cut_short_is_refused(tmp_path: Path, kind: str, share: float) -> None:
    whole = WHOLE[kind](tmp_path)
    (tmp_path / "cut").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(Rejected) as refused:
        load_scan(tmp_path / "cut")
    assert type(refused.value) in {FileTruncated, FileMalformed}, refused.value
    if "usdc" not in kind:
        assert type(refused.value) is FileTruncated, refused.value.detail


@pytest.mark.parametrize("kind", ["xyz", "csv", "cc.xyz", "obj"])
def test_text_cut_inside_a_row_is_refused(tmp_path: Path, kind: str) -> None:
    whole = WHOLE[kind](tmp_path)
    (tmp_path / "cut").write_bytes(whole[: whole.rindex(b"\n", 0, -20) + 4])
    with pytest.raises(FileTruncated):
        load_scan(tmp_path / "cut")


@pytest.mark.parametrize("kind", ["ply", "ascii.ply", "xyz", "pts", "csv", "obj", "glb", "usdc"])
def test_coordinates_that_are_no_numbers_are_refused(tmp_path: Path, kind: str) -> None:
    CLOUDS[kind](tmp_path / f"bad.{kind}", BAD)
    with pytest.raises(NotFinite) as refused:
        load_scan(tmp_path / f"bad.{kind}")
    assert refused.value.members["points"] == 1


@pytest.mark.parametrize("kind", sorted(CLOUDS))
def test_more_points_than_are_read_are_refused(tmp_path: Path, kind: str) -> None:
    CLOUDS[kind](tmp_path / f"a.{kind}", POINTS)
    with pytest.raises(TooManyPoints):
        load_scan(tmp_path / f"a.{kind}", Bounds(max_points=2_999))
    assert len(load_scan(tmp_path / f"a.{kind}", Bounds(max_points=3_000)).coarse()) == 3_000


def _las_promising(folder: Path, count: int) -> bytes:
    scan_files.las(folder / "a.las", POINTS)
    content = bytearray((folder / "a.las").read_bytes())
    content[107:111] = struct.pack("<I", count)
    return bytes(content)


def _laz_promising(folder: Path, count: int) -> bytes:
    scan_files.laz(folder / "a.laz", POINTS)
    content = bytearray((folder / "a.laz").read_bytes())
    content[107:111] = struct.pack("<I", count)
    return bytes(content)


def _glb(description: str, body: bytes = b"") -> bytes:
    text = description.encode()
    text += b" " * (-len(text) % 4)
    length = 20 + len(text) + 8 + len(body)
    head = b"glTF" + struct.pack("<II", 2, length) + struct.pack("<I", len(text)) + b"JSON"
    return head + text + struct.pack("<I", len(body)) + b"BIN\0" + body


def _glb_table(count: int) -> bytes:
    accessor = f'{{"count":{count},"type":"VEC3","componentType":5126,"bufferView":0}}'
    return _glb(
        '{"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":['
        + accessor
        + '],"bufferViews":[{"buffer":0}],"buffers":[{}]}',
        bytes(36),
    )


HOSTILE: dict[str, tuple[Callable[[Path], bytes], type[Rejected]]] = {
    "LAS of 3e9 points": (lambda folder: _las_promising(folder, 3_000_000_000), TooManyPoints),
    "LAS of 4e7 points": (lambda folder: _las_promising(folder, 40_000_000), FileTruncated),
    "LAS of no point": (lambda folder: _las_promising(folder, 0), FileEmpty),
    "LAZ of 3e9 points": (lambda folder: _laz_promising(folder, 3_000_000_000), TooManyPoints),
    "LAZ of 4e7 points": (lambda folder: _laz_promising(folder, 40_000_000), FileTruncated),
    "LAS magic alone": (lambda _: b"LASF" + bytes(40), FileTruncated),
    "LAS of noise": (lambda _: b"LASF" + scan_files.npy_like_noise(1, 4000), Rejected),
    "E57 magic alone": (lambda _: b"ASTM-E57", FileTruncated),
    "E57 of noise": (
        lambda _: b"ASTM-E57" + struct.pack("<IIQ", 1, 0, 4096) + scan_files.npy_like_noise(2, 4072),
        FileMalformed,
    ),
    "STL of 3e9 triangles": (
        lambda _: scan_files.stl_header(3_000_000_000) + bytes(48) + bytes(52),
        TooManyPoints,
    ),
    "STL of 3 triangles without area": (lambda _: scan_files.stl_header(3) + bytes(150), FileEmpty),
    "STL with a tail": (lambda _: scan_files.stl_header(1) + bytes(70), HeaderMismatch),
    "GLB of 3e9 corners": (lambda _: _glb_table(3_000_000_000), TooManyPoints),
    "GLB of 4e6 corners in 36 bytes": (lambda _: _glb_table(4_000_000), HeaderMismatch),
    "GLB of nothing": (lambda _: _glb("{}"), FileEmpty),
    "GLB in circles": (
        lambda _: _glb('{"nodes":[{"children":[1]},{"children":[0]}],"scenes":[{"nodes":[0]}]}'),
        FileMalformed,
    ),
    "GLB that is no JSON": (lambda _: _glb("[" * 100_000), FileMalformed),
    "GLB with another file": (lambda _: _glb('{"buffers":[{"uri":"/etc/passwd"}]}'), FileMalformed),
    "GLB with Draco": (
        lambda _: _glb('{"extensionsRequired":["KHR_draco_mesh_compression"]}'),
        FileMalformed,
    ),
    "PTS of 3e9 points": (lambda _: b"3000000000\n1 2 3 0\n", TooManyPoints),
    "PTS of 4e7 points": (lambda _: b"40000000\n1 2 3 0\n", FileTruncated),
    "PTS of fewer points": (lambda _: b"1\n1 2 3 0\n4 5 6 0\n", HeaderMismatch),
    "XYZ with words": (lambda _: b"1 2 3\none two three\n4 5 6\n", FileMalformed),
    "OBJ with a face behind its end": (lambda _: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", FileTruncated),
    "OBJ with a face before its start": (lambda _: b"v 0 0 0\nv 1 0 0\nf -1 -2 -9\n", FileMalformed),
    "OBJ with words": (lambda _: b"v 0 0 zero\nv 1 0 0\n", FileMalformed),
    "OBJ of a group": (lambda _: b"o nothing\ng here\n", FileEmpty),
    "USDA of nothing": (lambda _: b"#usda 1.0\n", FileEmpty),
    "USDA of noise": (lambda _: b"#usda 1.0\ndef def def", FileMalformed),
    "USDC of noise": (lambda _: b"PXR-USDC" + scan_files.npy_like_noise(3, 9000), FileMalformed),
    "a picture": (lambda _: b"\x89PNG\r\n\x1a\n" + bytes(99), UnsupportedMedia),
    "nothing": (lambda _: b"", FileEmpty),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_scan_is_refused_for_what_it_is(tmp_path: Path, name: str) -> None:
    content, leaf = HOSTILE[name]
    (tmp_path / "blob").write_bytes(content(tmp_path))
    with pytest.raises(leaf) as refused:
        load_scan(tmp_path / "blob")
    assert refused.value.detail.endswith(".")


def test_options_that_mean_nothing_are_refused() -> None:
    for wrong in ({"up": "w"}, {"unit": "parsec"}):
        with pytest.raises(InvalidRequest):
            ScanOptions.of(**wrong)
    with pytest.raises(InvalidRequest):
        ScanOptions(metres_per_unit=float("nan"))
