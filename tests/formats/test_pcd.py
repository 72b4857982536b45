"""Point cloud files: what is written loads elsewhere, and what lies is refused before it costs anything."""

from __future__ import annotations

import struct
from pathlib import Path

import lzf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from pypcd4 import Encoding
from pypcd4 import PointCloud as OtherCloud

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileMalformed,
    FileTruncated,
    HeaderMismatch,
    NotFinite,
    Rejected,
    TooManyPoints,
    UnsupportedMedia,
)
from worker.formats.pcd import read_pcd, write_pcd
from worker.geometry.cloud.point_cloud import PointCloud

POINTS = np.array([[0.5, -1.25, 2.0], [3.0, 4.0, 5.5], [1e3, -1e3, 0.0]])
CLOUD = PointCloud(POINTS, np.array([0, 3, 4_000_000_000], dtype=np.uint32))


def header(*, points: int = 3, width: int | None = None, height: int = 1, data: str = "binary") -> bytes:
    width = points if width is None else width
    return (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
        f"COUNT 1 1 1\nWIDTH {width}\nHEIGHT {height}\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA {data}\n"
    ).encode()


def body(points: np.ndarray = POINTS) -> bytes:
    return points.astype("<f4").tobytes()


def compressed(*, unpacked: int | None = None, plain: bytes | None = None) -> bytes:
    plain = POINTS.astype("<f4").T.tobytes() if plain is None else plain
    packed = lzf.compress(plain, len(plain) + 64)
    return struct.pack("<II", len(packed), len(plain) if unpacked is None else unpacked) + packed


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", CLOUD)
    read = read_pcd(tmp_path / "a.pcd")
    np.testing.assert_array_equal(read.points, CLOUD.points)
    np.testing.assert_array_equal(read.labels, CLOUD.labels)


def test_the_same_cloud_gives_the_same_bytes(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", CLOUD)
    write_pcd(tmp_path / "b.pcd", CLOUD)
    assert (tmp_path / "a.pcd").read_bytes() == (tmp_path / "b.pcd").read_bytes()


def test_pypcd4_finds_the_same_points_and_labels(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", CLOUD)
    other = OtherCloud.from_path(tmp_path / "a.pcd")
    assert other.fields == ("x", "y", "z", "label")
    assert other.metadata.type == ("F", "F", "F", "U")
    np.testing.assert_array_equal(other.numpy(("x", "y", "z")).astype(np.float64), CLOUD.points)
    np.testing.assert_array_equal(other.pc_data["label"], CLOUD.labels)


def test_open3d_finds_the_same_points(tmp_path: Path) -> None:
    open3d = pytest.importorskip("open3d")
    write_pcd(tmp_path / "a.pcd", CLOUD)
    cloud = open3d.t.io.read_point_cloud(str(tmp_path / "a.pcd"))
    np.testing.assert_array_equal(cloud.point.positions.numpy().astype(np.float64), CLOUD.points)
    np.testing.assert_array_equal(cloud.point.label.numpy().ravel(), CLOUD.labels)


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
def test_every_encoding_of_pypcd4_is_read(tmp_path: Path, encoding: str) -> None:
    other = OtherCloud.from_xyzl_points(np.column_stack([POINTS, [1, 2, 4]]), label_type=np.uint32)
    other.save(tmp_path / "a.pcd", encoding=Encoding(encoding))
    read = read_pcd(tmp_path / "a.pcd")
    np.testing.assert_allclose(read.points, POINTS, rtol=1e-6)
    assert read.labels.tolist() == [1, 2, 4]


def test_fields_of_other_types_and_counts_are_passed_over(tmp_path: Path) -> None:
    head = (
        "VERSION .7\nFIELDS rgb y normal x z\nSIZE 1 8 4 8 8\nTYPE U F F F F\nCOUNT 1 1 3 1 1\n"
        "WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA "
    )
    dtype = np.dtype([("c", "u1"), ("y", "<f8"), ("n", "<f4", (3,)), ("x", "<f8"), ("z", "<f8")])
    record = np.zeros(2, dtype=dtype)
    record["x"], record["y"], record["z"] = [1, 2], [3, 4], [5, 6]
    (tmp_path / "b.pcd").write_bytes((head + "binary\n").encode() + record.tobytes())
    (tmp_path / "a.pcd").write_text(head + "ascii\n7 3 0 0 0 1 5\n7 4 0 0 0 2 6\n")
    for name in ("a.pcd", "b.pcd"):
        assert read_pcd(tmp_path / name).points.tolist() == [[1, 3, 5], [2, 4, 6]]


def test_pixels_without_return_are_left_out_of_an_organised_cloud(tmp_path: Path) -> None:
    pixels = np.vstack([POINTS, np.full((1, 3), np.nan)])
    (tmp_path / "a.pcd").write_bytes(header(points=4, width=2, height=2) + body(pixels))
    np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd").points, POINTS)


NAN = np.vstack([POINTS[:2], [[np.nan, 0.0, 0.0]]])
INFINITE = np.vstack([POINTS[:2], [[np.inf, 0.0, 0.0]]])
HOSTILE: dict[str, tuple[bytes, type[Rejected]]] = {
    "no bytes": (b"", FileEmpty),
    "no point": (header(points=0), FileEmpty),
    "only pixels without return": (
        header(points=4, width=2, height=2) + body(np.full((4, 3), np.nan)), FileEmpty,
    ),
    "a body cut short": (header() + body()[:-1], FileTruncated),
    "a header cut short": (header()[:60], FileTruncated),
    "no body": (header(), FileTruncated),
    "3e9 points": (header(points=3_000_000_000) + body(), TooManyPoints),
    "more points than bytes": (header(points=40_000_000) + body(), FileTruncated),
    "more text points than bytes": (header(points=40_000_000, data="ascii") + b"0 0 0\n", FileTruncated),
    "more compressed points than bytes": (
        header(points=40_000_000, data="binary_compressed") + compressed(unpacked=480_000_000),
        FileTruncated,
    ),
    "rows times columns differ": (header(points=3, width=5) + body(), HeaderMismatch),
    "a compressed size that lies": (
        header(data="binary_compressed") + compressed(unpacked=0xFFFFFFFF), HeaderMismatch,
    ),
    "a compressed body cut short": (header(data="binary_compressed") + compressed()[:-5], FileTruncated),
    "a compressed body of noise": (
        header(data="binary_compressed") + struct.pack("<II", 9, 36) + b"\xff" * 9, FileMalformed,
    ),
    "a compressed body too short inside": (
        header(data="binary_compressed") + compressed(unpacked=36, plain=b"\0" * 20), FileMalformed,
    ),
    "NaN": (header() + body(NAN), NotFinite),
    "infinity": (header() + body(INFINITE), NotFinite),
    "infinity in an organised cloud": (header(points=3, width=1, height=3) + body(INFINITE), NotFinite),
    "words for numbers": (header(data="ascii") + b"1 2 3\none two three\n4 5 6\n", FileMalformed),
    "too few text lines": (header(data="ascii") + b"1.000 2.000 3.000\n4.00 5.00 6.00\n", FileTruncated),
    "an unknown encoding": (header(data="zip") + body(), FileMalformed),
    "no z": (header().replace(b"x y z", b"x y w") + body(), FileMalformed),
    "lines of different length": (header().replace(b"SIZE 4 4 4", b"SIZE 4 4") + body(), HeaderMismatch),
    "a type that does not exist": (header().replace(b"TYPE F", b"TYPE Q") + body(), FileMalformed),
    "a negative number of points": (header().replace(b"POINTS 3", b"POINTS -3") + body(), FileMalformed),
    "a huge count": (header().replace(b"COUNT 1", b"COUNT 999999999") + body(), FileMalformed),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(100), UnsupportedMedia),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_for_what_it_is(tmp_path: Path, name: str) -> None:
    content, leaf = HOSTILE[name]
    (tmp_path / "a.pcd").write_bytes(content)
    with pytest.raises(Rejected) as refusal:
        read_pcd(tmp_path / "a.pcd")
    assert type(refusal.value) is leaf
    assert refusal.value.detail.endswith(".")


def test_the_limit_of_points_is_the_callers(tmp_path: Path) -> None:
    write_pcd(tmp_path / "a.pcd", CLOUD)
    assert len(read_pcd(tmp_path / "a.pcd", Bounds(max_points=3))) == 3
    with pytest.raises(TooManyPoints):
        read_pcd(tmp_path / "a.pcd", Bounds(max_points=2))


@given(content=st.binary(max_size=200), cut=st.integers(0, 260))
def test_no_bytes_end_in_anything_but_a_refusal_or_a_cloud(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, cut: int
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "a.pcd"
    for data in ("ascii", "binary", "binary_compressed"):
        path.write_bytes((header(data=data) + content)[:cut])
        try:
            cloud = read_pcd(path)
        except Rejected:
            continue
        assert len(cloud) == 3


@given(points=hnp.arrays(np.float32, st.tuples(st.integers(1, 20), st.just(3)),
                         elements=st.floats(-1e6, 1e6, width=32)))  # fmt: skip
def test_single_precision_survives_the_round_trip(
    tmp_path_factory: pytest.TempPathFactory, points: np.ndarray
) -> None:
    path = tmp_path_factory.mktemp("round") / "a.pcd"
    write_pcd(path, PointCloud.of(points))
    np.testing.assert_array_equal(read_pcd(path).points, points.astype(np.float64))
