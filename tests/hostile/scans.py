"""A small right scan of every kind that is taken, the same bytes each time."""

from __future__ import annotations

import io
import re
import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import lzf
import numpy as np

from tests import files
from tests.formats import scan_files

_COUNT = 900
_SIZE = np.array([3.0, 2.0, 2.5])
_E57_PAGE = 1024
_LAS_DATE = slice(90, 94)

Write = Callable[[Path, np.ndarray], None]


def _points() -> np.ndarray:
    return np.round(files.room(_COUNT), 3)


def _by(write: Write, suffix: str, what: Callable[[], np.ndarray]) -> Callable[[], bytes]:
    """Return what makes a file by a function that writes points, or the box of a size, to a path."""

    def make() -> bytes:
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"scan.{suffix}"
            write(path, what())
            return path.read_bytes()

    return make


def _cloud(kind: str, suffix: str = "") -> Callable[[], bytes]:
    return _by(scan_files.CLOUDS[kind], suffix or kind, _points)


def _box(kind: str, suffix: str = "") -> Callable[[], bytes]:
    return _by(scan_files.BOXES[kind], suffix or kind, lambda: _SIZE)


def _las(kind: str) -> bytes:
    content = bytearray(_cloud(kind)())
    content[_LAS_DATE] = struct.pack("<HH", 1, 2026)
    return bytes(content)


def _pcd_of_text() -> bytes:
    head, _, _ = files.pcd(_points()).partition(b"DATA")
    return head + b"DATA ascii\n" + "".join(f"{x} {y} {z}\n" for x, y, z in _points().tolist()).encode()


def _packed_pcd() -> bytes:
    """Return an organised cloud, packed by LZF, some of its pixels without a return."""
    points = _points().astype("<f4")
    points[::50] = np.nan
    head, _, _ = files.pcd(points).partition(b"WIDTH")
    head += f"WIDTH 30\nHEIGHT {_COUNT // 30}\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {_COUNT}\n".encode()
    plain = points.T.tobytes()
    packed = lzf.compress(plain)
    return head + b"DATA binary_compressed\n" + struct.pack("<II", len(packed), len(plain)) + packed


def _usda() -> bytes:
    corners = ", ".join(f"({x:g}, {y:g}, {z:g})" for x, y, z in (scan_files.BOX_CORNERS * _SIZE).tolist())
    indices = ", ".join(str(i) for i in scan_files.BOX_TRIANGLES.ravel().tolist())
    return (
        '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n\ndef Xform "world"\n{\n'
        "    matrix4d xformOp:transform = ( (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1) )\n"
        '    uniform token[] xformOpOrder = ["xformOp:transform"]\n    def Mesh "box"\n    {\n'
        f"        int[] faceVertexCounts = [{', '.join('3' * len(scan_files.BOX_TRIANGLES))}]\n"
        f"        int[] faceVertexIndices = [{indices}]\n        point3f[] points = [{corners}]\n    }}\n}}\n"
    ).encode()


def _e57() -> bytes:
    """Return two stations with identifiers and dates that are the same each time."""
    content = _cloud("e57")()
    known: dict[bytes, bytes] = {}
    plain = b"".join(content[at : at + _E57_PAGE - 4] for at in range(0, len(content), _E57_PAGE))
    plain = re.sub(rb"\{[0-9A-Fa-f-]{36}\}", lambda m: known.setdefault(m[0], b"{%036d}" % len(known)), plain)
    plain = re.sub(rb"(dateTimeValue[^>]*>)([0-9.eE+-]+)", lambda m: m[1] + b"1" * len(m[2]), plain)
    return _paged(plain)


def resealed_e57(content: bytes) -> bytes:
    """Return an E57 file with the checksums of its pages made right, so that readers look further."""
    return _paged(b"".join(content[at : at + _E57_PAGE - 4] for at in range(0, len(content), _E57_PAGE)))


def _paged(plain: bytes) -> bytes:
    size = _E57_PAGE - 4
    pages = (plain[at : at + size].ljust(size, b"\0") for at in range(0, len(plain), size))
    return b"".join(page + struct.pack(">I", _crc32c(page)) for page in pages)


def _crc_table() -> list[int]:
    table = []
    for value in range(256):
        crc = value
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
        table.append(crc)
    return table


_TABLE = _crc_table()


def _crc32c(content: bytes) -> int:
    """Return Castagnoli's checksum, as E57 keeps it (ASTM E2807, 6.2)."""
    crc = 0xFFFFFFFF
    for byte in content:
        crc = _TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    return crc ^ 0xFFFFFFFF


def _usdz() -> bytes:
    """Return a package whose entry is of a fixed date (APPNOTE 4.3.7 and 4.3.12)."""
    content = bytearray(_box("usdz")())
    for mark, at in ((b"PK\x03\x04", 10), (b"PK\x01\x02", 12)):
        start = content.find(mark) + at
        content[start : start + 4] = bytes(4)
    return bytes(content)


def _obj() -> bytes:
    sink = io.BytesIO()
    sink.write(_box("obj")())
    sink.write(b"s off\nl 1 2\nvn 0 0 1\nvt 0 0\n")
    return sink.getvalue()


MAKERS: dict[str, Callable[[], bytes]] = {
    "ply": lambda: files.ply(_points()),
    "text.ply": _cloud("ascii.ply", "ply"),
    "big.ply": _cloud("big.ply", "ply"),
    "mesh.ply": _box("ply"),
    "text-mesh.ply": _box("ascii.ply", "ply"),
    "quads.ply": _box("quads.ply", "ply"),
    "pcd": lambda: files.pcd(_points()),
    "text.pcd": _pcd_of_text,
    "packed.pcd": _packed_pcd,
    "las": lambda: _las("las"),
    "laz": lambda: _las("laz"),
    "e57": _e57,
    "xyz": _cloud("xyz"),
    "pts": _cloud("pts"),
    "csv": _cloud("csv"),
    "comma.csv": _cloud("comma.csv", "csv"),
    "obj": _obj,
    "cloud.obj": _cloud("obj"),
    "stl": _box("stl"),
    "text.stl": _box("ascii.stl", "stl"),
    "glb": _box("glb"),
    "cloud.glb": _cloud("glb"),
    "usdc": _box("usdc"),
    "cloud.usdc": _cloud("usdc"),
    "usda": _usda,
    "usdz": _usdz,
}
"""What makes a scan, by the name of its kind."""
