"""Scans that once took a worker down, with their sisters: places that are none, and headers that lie."""

from __future__ import annotations

import io
import math
import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import laspy
import numpy as np

from tests import files
from tests.formats import scan_files
from tests.hostile import scans
from tests.hostile.known import READING, Known

_FAR = 1e7


def _scan(make: Callable[[], bytes], ends: str) -> Known:
    return Known("scans", make, ends)


# --- scans: places that are none ----------------------------------------------------------------------------


def _with_places(kind: str, value: float) -> Callable[[], bytes]:
    """Return what makes a cloud of a kind with one coordinate replaced."""

    def make() -> bytes:
        points = np.round(files.room(900), 3)
        points[17, 1] = value
        if kind == "pcd":
            return files.pcd(points)
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"scan.{kind.rpartition('.')[2]}"
            scan_files.CLOUDS[kind](path, points)
            return path.read_bytes()

    return make


def _corners(size: float) -> list[tuple[float, float, float]]:
    return [(0.0, 0.0, 0.0), (size, 0.0, 0.0), (0.0, size, 0.0), (0.0, 0.0, size)]


def _obj(size: float) -> bytes:
    return "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in _corners(size)).encode() + b"f 1 2 3\nf 1 3 4\n"


def _stl(size: float) -> bytes:
    a, b, c, d = _corners(size)
    out = bytes(80) + struct.pack("<I", 4)
    for three in ((a, b, c), (a, c, d), (a, d, b), (b, c, d)):
        out += struct.pack("<12fH", 0, 0, 1, *three[0], *three[1], *three[2], 0)
    return out


def _box(kind: str, size: float) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"scan.{kind.rpartition('.')[2]}"
        scan_files.BOXES[kind](path, np.full(3, size))
        return path.read_bytes()


def _same_places(count: int = 500_000, *, of: float = 1.0) -> np.ndarray:
    """Return points of a room of which a share lies at the origin: what a depth camera missed."""
    points = files.room(count)
    points[: round(of * count)] = 0.0
    return points


def _few_places(count: int = 500_000) -> np.ndarray:
    return np.repeat(files.room(40), count // 40, axis=0)


def _las(name: str, change: Callable[[bytearray], None]) -> Callable[[], bytes]:
    def make() -> bytes:
        content = bytearray(scans.MAKERS[name]())
        change(content)
        return bytes(content)

    return make


def _las_14() -> bytes:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    record = laspy.LasData(header)
    record.x, record.y, record.z = np.round(files.room(900), 3).T
    sink = io.BytesIO()
    record.write(sink)
    return sink.getvalue()


def _lying_extended() -> bytes:
    content = bytearray(_las_14())
    struct.pack_into("<QI", content, 235, 375, 0xFFFFFFFF)
    return bytes(content)


def _lying_points_of_14() -> bytes:
    content = bytearray(_las_14())
    struct.pack_into("<Q", content, 247, 40_000_000)
    return bytes(content)


def _end_of(value: float) -> str:
    return "coordinates-too-large" if math.isfinite(value) else "not-finite"


_PLACES = (1e154, 1e308, 1e38, 1e20, math.nan, math.inf)
_DOUBLE = ("ply", "ascii.ply", "big.ply", "xyz", "pts", "csv", "comma.csv", "cc.xyz", "obj")
_SINGLE = ("pcd", "glb", "usdc")


def _doubling(depth: int) -> bytes:
    parts = [
        f'def "a{k}"\n{{\n def "l" (references = </a{k + 1}>) {{}}\n'
        f' def "r" (references = </a{k + 1}>) {{}}\n}}\n'
        for k in range(depth)
    ]
    return ("#usda 1.0\n" + "".join(parts)).encode() + b'def Xform "a%d" {}\n' % depth


KNOWN_SCANS: dict[str, Known] = {
    **{f"ply with {value:g}": _scan(_with_places("ply", value), _end_of(value)) for value in _PLACES},
    **{f"{kind} with 1e154": _scan(_with_places(kind, 1e154), _end_of(1e154)) for kind in _DOUBLE[1:]},
    **{f"{kind} with 1e38": _scan(_with_places(kind, 1e38), _end_of(1e38)) for kind in _SINGLE},
    **{f"{kind} with nan": _scan(_with_places(kind, math.nan), _end_of(math.nan)) for kind in _SINGLE},
    "USDA of parts that double": _scan(lambda: _doubling(24), "file-malformed"),
    "OBJ of 10,000 km": _scan(lambda: _obj(_FAR), "coordinates-too-large"),
    "STL of 10,000 km": _scan(lambda: _stl(_FAR), "coordinates-too-large"),
    **{
        f"{kind} box of 10,000 km": _scan(lambda kind=kind: _box(kind, _FAR), "coordinates-too-large")
        for kind in scan_files.BOXES
    },
    "STL of 1e30 m": _scan(lambda: _stl(1e30), "coordinates-too-large"),
    "OBJ of 1e154 m": _scan(lambda: _obj(1e154), "coordinates-too-large"),
    "500,000 points at one place": _scan(lambda: files.ply(_same_places()), READING),
    "PCD of 500,000 points at one place": _scan(lambda: files.pcd(_same_places()), READING),
    "500,000 points, half of them zeros": _scan(lambda: files.ply(_same_places(of=0.5)), READING),
    "500,000 points at 40 places": _scan(lambda: files.ply(_few_places()), READING),
    "500,000 points on a line": _scan(
        lambda: files.ply(np.outer(np.linspace(0, 5, 500_000), [1.0, 0.0, 0.0])), READING
    ),
    "LAS of 4 billion records": _scan(
        _las("las", lambda c: struct.pack_into("<I", c, 100, 0xFFFFFFFF)), "header-mismatch"
    ),
    "LAS of 40 million points": _scan(
        _las("las", lambda c: struct.pack_into("<I", c, 107, 40_000_000)), "file-truncated"
    ),
    "LAS with points of no bytes": _scan(
        _las("las", lambda c: struct.pack_into("<H", c, 105, 0)), "file-malformed"
    ),
    "LAS whose points begin behind its end": _scan(
        _las("las", lambda c: struct.pack_into("<I", c, 96, 0x7FFFFFFF)), "file-truncated"
    ),
    "LAS scaled by 1e300": _scan(
        _las("las", lambda c: struct.pack_into("<d", c, 131, 1e300)), "coordinates-too-large"
    ),
    "LAS scaled by nothing": _scan(
        _las("las", lambda c: struct.pack_into("<3d", c, 131, 0, 0, 0)), "not-finite"
    ),
    "LAS moved by NaN": _scan(_las("las", lambda c: struct.pack_into("<d", c, 155, math.nan)), "not-finite"),
    "LAS 1.4 of 4 billion extended records": _scan(_lying_extended, "header-mismatch"),
    "LAS 1.4 of 40 million points": _scan(_lying_points_of_14, "file-truncated"),
    "LAZ of 40 million points": _scan(
        _las("laz", lambda c: struct.pack_into("<I", c, 107, 40_000_000)), "file-truncated"
    ),
}
"""The scans, by what they are."""
