"""Small files of every kind that is uploaded, right and wrong ones, made on the spot."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"


def png(width: int = 64, height: int = 48, *, seed: int = 0) -> bytes:
    """Return a grey PNG of noise, different for each seed."""
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width), dtype=np.uint8)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    header = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return PNG_MAGIC + header + _chunk(b"IDAT", zlib.compress(rows)) + _chunk(b"IEND", b"")


def white_png(width: int, height: int) -> bytes:
    """Return a right PNG of one bit a pixel, all white, however large; compressed as it is made."""
    row = b"\0" + b"\xff" * ((width + 7) // 8)
    compressor = zlib.compressobj(1)
    parts = [compressor.compress(row * 64) for _ in range(height // 64)]
    parts += [compressor.compress(row * (height % 64)), compressor.flush()]
    header = _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    return PNG_MAGIC + header + _chunk(b"IDAT", b"".join(parts)) + _chunk(b"IEND", b"")


def ply_header(points: int) -> bytes:
    """Return the header of a binary PLY that promises so many points of 12 bytes."""
    return (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {points}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    ).encode()


def ply(points: ArrayLike) -> bytes:
    """Return a binary PLY of (N, 3) points."""
    array = np.asarray(points, dtype="<f4")
    return ply_header(len(array)) + array.tobytes()


def pcd(points: ArrayLike) -> bytes:
    """Return a binary PCD of (N, 3) points."""
    array = np.asarray(points, dtype="<f4")
    n = len(array)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
        f"COUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
    )
    return header.encode() + array.tobytes()


def room(count: int = 5_000, *, seed: int = 0) -> np.ndarray:
    """Return points (count, 3) on the floor and the four walls of a room of 6 by 4 by 2.5 m."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([0, 0, 0], [6, 4, 2.5], (count, 3))
    face = rng.integers(0, 5, count)
    for k, (axis, value) in enumerate([(2, 0.0), (0, 0.0), (0, 6.0), (1, 0.0), (1, 4.0)]):
        points[face == k, axis] = value
    return points


def zeros(count: int, *, first: bytes = b"") -> Iterator[bytes]:
    """Give `count` bytes in pieces of 1 MiB: `first`, then zeros."""
    yield first
    left = count - len(first)
    block = bytes(1 << 20)
    while left > 0:
        yield block[: min(left, len(block))]
        left -= len(block)


def form(file: Iterator[bytes], *, boundary: str = "b0undary", name: str = "scan.ply") -> Iterator[bytes]:
    """Give a multipart form with one file, streamed."""
    yield (
        f'--{boundary}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n'
        "Content-Type: application/octet-stream\r\n\r\n"
    ).encode()
    yield from file
    yield f"\r\n--{boundary}--\r\n".encode()


def _chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
