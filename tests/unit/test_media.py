"""What a file is, told by its first bytes."""

from __future__ import annotations

import io
import zipfile

import pytest

from service.domain.bounds import Bounds
from service.domain.checksum import Checksum
from service.domain.errors import (
    ChecksumMismatch,
    FileEmpty,
    FileMalformed,
    FileTruncated,
    ImageTooLarge,
    TooManyPoints,
    UnsupportedMedia,
)
from service.domain.formats import JPEG, Purpose
from service.domain.headers import check_header
from service.domain.media import HEAD_BYTES, accept, recognise
from tests import files


def _zipped(*names: str) -> bytes:
    """Return the beginning of a ZIP with entries of these names."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in names:
            archive.writestr(name, "")
    return file.getvalue()


KINDS = {
    b"\x89PNG\r\n\x1a\n": "image/png",
    b"\xff\xd8\xff\xe0": "image/jpeg",
    b"II*\x00": "image/tiff",
    b"MM\x00*": "image/tiff",
    b"BM\x36\x00\x00\x00\x00\x00\x00\x00": "image/bmp",
    b"BMW is no bitmap": "text/plain",
    b"ply\nformat ascii 1.0\n": "application/vnd.groundplan.ply",
    b"# .PCD v0.7\n": "application/vnd.groundplan.pcd",
    b"# made by hand\nVERSION 0.7\nFIELDS x y z\n": "application/vnd.groundplan.pcd",
    b"%PDF-1.7": "application/pdf",
    b"junk before %PDF-1.4": "application/pdf",
    b"AC1032\0\0": "image/vnd.dwg",
    b"  0\r\nSECTION\r\n  2\r\nHEADER\r\n": "image/vnd.dxf",
    b"999\nmade by x\n  0\nSECTION\n": "image/vnd.dxf",
    b'\xef\xbb\xbf<?xml version="1.0"?>\n<svg xmlns="...">': "image/svg+xml",
    b"ISO-10303-21;\nHEADER;": "application/x-step",
    b"glTF\x02\0\0\0": "model/gltf-binary",
    b"# Blender\nmtllib a.mtl\no Cube\nv 1 2 3\n": "model/obj",
    b"LASF\0\0": "application/vnd.las",
    b"ASTM-E57\x01": "model/e57",
    b"RIFF\x10\0\0\0WEBPVP8 ": "image/webp",
    b"P5\n# CREATOR: map_saver\n40 30\n255\n\0\1": "image/x-portable-graymap",
    b"P2 4 4 255 1 2": "image/x-portable-graymap",
    b"image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n": "application/vnd.groundplan.ros-map",
    b"# by hand\nresolution: 0.05\nimage: map.pgm\n": "application/vnd.groundplan.ros-map",
    b"coordinate_system: reference_image\nlevels:\n  L1:\n": "application/vnd.groundplan.building",
    b"AutoCAD Binary DXF\r\n\x1a\0": "image/vnd.dxf",
    b'<svg xmlns="http://www.w3.org/2000/svg">': "image/svg+xml",
    b'<!-- a note --><!DOCTYPE svg [<!ENTITY a "b">]><svg>': "image/svg+xml",
    b"PK\x03\x04": "application/zip",
    _zipped("word/document.xml", "map.docx"): "application/zip",
    _zipped("maps/", "maps/map.yaml", "maps/map.pgm"): "application/vnd.groundplan.ros-map+zip",
    _zipped("plant/", "plant/.DS_Store", "__MACOSX/._x", "plant/map.png"): (
        "application/vnd.groundplan.ros-map+zip"
    ),
    _zipped("map.png", "map.yaml"): "application/vnd.groundplan.ros-map+zip",
    _zipped("scan.usdc", "0/texture.png"): "model/vnd.usdz+zip",
    b"PXR-USDC\0\x08": "model/vnd.usd",
    b"#usda 1.0\n(\n)\n": "model/vnd.usd",
    b"1.0 2.0 3.0\n": "text/plain",
    b"//X Y Z R G B\n.5 -1e-3 3 1 2 3\n": "text/plain",
    b"120\n1 2 3 -200 1 1 1\n": "text/plain",
    b'"x","y","z"\n1,2,3\n': "text/plain",
    b"solid scan\n facet normal 0 0 1\n": "model/stl",
    bytes(80) + b"\1\0\0\0" + bytes(8) + b"\0\0\x80\x3f" + bytes(38): "model/stl",
    bytes(200): "application/octet-stream",
    b"<!DOCTYPE html><html>": "text/html",
    b"\0\1\2\3": "application/octet-stream",
}


@pytest.mark.parametrize("head", KINDS)
def test_every_kind_is_told_by_its_bytes(head: bytes) -> None:
    assert recognise(head).media_type == KINDS[head]


def test_what_is_not_read_is_refused_with_advice() -> None:
    for head in KINDS:
        for purpose in Purpose:
            if recognise(head).fits is purpose:
                assert accept(head, purpose) is recognise(head)
            else:
                with pytest.raises(UnsupportedMedia) as refused:
                    accept(head, purpose)
                assert refused.value.detail.endswith(".")
    with pytest.raises(FileEmpty):
        accept(b"", Purpose.SCAN)


def check(content: bytes, *, size: int | None = None, bounds: Bounds | None = None) -> None:
    head = content[:HEAD_BYTES]
    found = len(content) if size is None else size
    check_header(head, recognise(head), size_bytes=found, bounds=bounds or Bounds())


def test_headers_are_compared_with_the_file_s_size() -> None:
    for whole in (files.ply(files.room()), files.pcd(files.room())):
        check(whole)
        with pytest.raises(FileTruncated):
            check(whole, size=len(whole) - 1)
        with pytest.raises(TooManyPoints):
            check(whole, bounds=Bounds(max_points=4_999))
        check(whole, bounds=Bounds(max_points=5_000))
        with pytest.raises(FileTruncated):
            check(whole[:50])
    with pytest.raises(FileMalformed):
        check(b"ply\n" + b"comment x\n" * 10_000)
    with pytest.raises(FileMalformed):
        check(files.ply(files.room()).replace(b"vertex 5000", b"vertex five"))


def test_pixels_are_counted_before_they_are_decoded() -> None:
    check(files.png(100, 100), bounds=Bounds(max_pixels=10_000))
    with pytest.raises(ImageTooLarge):
        check(files.png(100, 101), bounds=Bounds(max_pixels=10_000))
    frame = b"\xff\xd8\xff\xe0\x00\x04ab\xff\xc0\x00\x11\x08\xff\xff\xff\xff\x03" + bytes(20)
    assert recognise(frame) is JPEG
    with pytest.raises(ImageTooLarge):
        check(frame)


def test_a_checksum_of_other_bytes_is_refused() -> None:
    checksum = Checksum("sha1 Kq5sNclPz7QV2+lfQIuc6R7oRu0=")
    checksum.update(b"hello ")
    with pytest.raises(ChecksumMismatch):
        checksum.verify()
    checksum.update(b"world")
    checksum.verify()
