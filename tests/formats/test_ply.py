"""Polygon files: every encoding is read, faces are passed over, and what lies is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plyfile import PlyData, PlyElement

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
from worker.formats.pcd import write_pcd
from worker.formats.ply import read_ply
from worker.formats.scan import read_scan
from worker.geometry.cloud.point_cloud import PointCloud

POINTS = np.array([[0.5, -1.25, 2.0], [3.0, 4.0, 5.5], [100.0, -100.0, 0.0]])


def ply(*, text: bool = False, order: str = "<", faces: bool = True) -> PlyData:
    vertex = np.zeros(3, dtype=[("red", "u1"), ("x", "f4"), ("y", "f8"), ("z", "f4")])
    vertex["x"], vertex["y"], vertex["z"] = POINTS.T
    elements = [PlyElement.describe(vertex, "vertex")]
    if faces:
        face = np.zeros(1, dtype=[("vertex_indices", "i4", (3,))])
        face["vertex_indices"] = [[0, 1, 2]]
        elements.append(PlyElement.describe(face, "face"))
    return PlyData(elements, text=text, byte_order="=" if text else order)


@pytest.mark.parametrize("faces", [False, True])
@pytest.mark.parametrize(("text", "order"), [(True, "<"), (False, "<"), (False, ">")])
def test_every_encoding_is_read(tmp_path: Path, text: bool, order: str, faces: bool) -> None:  # noqa: FBT001
    ply(text=text, order=order, faces=faces).write(str(tmp_path / "a.ply"))
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply").points, POINTS)


def test_elements_before_the_vertices_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement camera 2\nproperty float f\nelement vertex 1\n"
        "property float x\nproperty float y\nproperty float z\nend_header\n9\n8\n1 2 3\n"
    )
    assert read_ply(tmp_path / "a.ply").points.tolist() == [[1, 2, 3]]


def header(*, count: int = 3, form: str = "binary_little_endian", more: str = "") -> bytes:
    return (
        f"ply\nformat {form} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n"
        f"property float z\n{more}end_header\n"
    ).encode()


BODY = POINTS.astype("<f4").tobytes()
BAD = np.vstack([POINTS[:2], [[0.0, np.nan, 0.0]]]).astype("<f4").tobytes()
HOSTILE: dict[str, tuple[bytes, type[Rejected]]] = {
    "no bytes": (b"", FileEmpty),
    "no vertex": (header(count=0), FileEmpty),
    "cut short": (header() + BODY[:-1], FileTruncated),
    "header cut short": (header()[:40], FileTruncated),
    "faces cut short": (
        header(more="element face 1\nproperty list uchar int vertex_indices\n") + BODY + b"\x03\0\0",
        FileTruncated,
    ),
    "3e9 vertices": (header(count=3_000_000_000) + BODY, TooManyPoints),
    "3e9 faces": (
        header(more="element face 3000000000\nproperty list uchar int vertex_indices\n") + BODY,
        TooManyPoints,
    ),
    "more vertices than bytes": (header(count=40_000_000) + BODY, FileTruncated),
    "text of too few lines": (header(form="ascii") + b"1.000 2.000 3.000\n4.000 5.000 6.0\n", FileTruncated),
    "text of words": (header(form="ascii") + b"1 2 3\na b c d e f\n4 5 6\n", HeaderMismatch),
    "text with short lines": (header(form="ascii") + b"1 2 3\n4 5\n4 5 6 7 8 9\n", HeaderMismatch),
    "NaN": (header() + BAD, NotFinite),
    "NaN in text": (header(form="ascii") + b"1 2 3\nnan 1 2\n4 5 6\n", NotFinite),
    "no z": (header().replace(b"float z", b"float w") + BODY, FileMalformed),
    "x twice": (header().replace(b"float y", b"float x") + BODY, FileMalformed),
    "an unknown type": (header().replace(b"float y", b"quad y") + BODY, FileMalformed),
    "an unknown format": (header(form="binary_middle") + BODY, FileMalformed),
    "a picture": (b"\x89PNG\r\n\x1a\n" + bytes(100), UnsupportedMedia),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_file_is_refused_for_what_it_is(tmp_path: Path, name: str) -> None:
    content, leaf = HOSTILE[name]
    (tmp_path / "a.ply").write_bytes(content)
    with pytest.raises(Rejected) as refusal:
        read_ply(tmp_path / "a.ply")
    assert type(refusal.value) is leaf
    assert refusal.value.detail.endswith(".")


def test_the_limit_of_points_is_the_callers(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_bytes(header() + BODY)
    with pytest.raises(TooManyPoints):
        read_ply(tmp_path / "a.ply", Bounds(max_points=2))


@given(content=st.binary(max_size=120), cut=st.integers(0, 300), form=st.sampled_from(
    ["ascii", "binary_little_endian", "binary_big_endian"]))  # fmt: skip
def test_no_bytes_end_in_anything_but_a_refusal_or_a_cloud(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, cut: int, form: str
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "a.ply"
    path.write_bytes((header(form=form, more="element face 1\nproperty list uchar int i\n") + content)[:cut])
    try:
        cloud = read_ply(path)
    except Rejected:
        return
    assert len(cloud) == 3


def test_a_scan_is_told_by_its_bytes_not_its_name(tmp_path: Path) -> None:
    write_pcd(tmp_path / "scan.ply", PointCloud.of(POINTS))
    ply().write(str(tmp_path / "scan.pcd"))
    np.testing.assert_array_equal(read_scan(tmp_path / "scan.ply").points, POINTS)
    np.testing.assert_array_equal(read_scan(tmp_path / "scan.pcd").points, POINTS)
    (tmp_path / "picture.pcd").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(UnsupportedMedia):
        read_scan(tmp_path / "picture.pcd")
    (tmp_path / "empty.pcd").write_bytes(b"")
    with pytest.raises(FileEmpty):
        read_scan(tmp_path / "empty.pcd")
