"""Refusals that a file's own header justifies at once, before any job looks at the rest.

Only a bounded number of first bytes is read, with the standard library. Silence here says nothing:
the readers of `worker.formats` check again, and more.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from service.domain.bounds import Bounds
from service.domain.errors import FileEmpty, FileMalformed, FileTruncated, ImageTooLarge, TooManyPoints
from service.domain.formats import JPEG, LAS, PCD, PLY, PNG, Media
from service.domain.media import HEAD_BYTES

_PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
_SOF = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


@dataclass(frozen=True)
class Told:
    """Hold what a file's first bytes tell of its content; None is what they do not tell."""

    points: int | None = None
    pixels: int | None = None


def check_header(head: bytes, media: Media, *, size_bytes: int, bounds: Bounds) -> Told:
    """Return what a file's header tells; refuse one that alone shows that it is cut short or too large.

    Parameters
    ----------
    head : bytes
        The first `HEAD_BYTES` of the file.
    media : Media
        What `recognise` said of it.
    size_bytes : int
        Size of the whole file.
    bounds : Bounds
        The most pixels and points that are read.

    Raises
    ------
    ImageTooLarge, TooManyPoints
        If the header promises more than is read.
    FileEmpty
        If it promises no pixel or no point.
    FileTruncated
        If it promises more than the file's size can hold.
    FileMalformed
        If it has no end.
    """
    if media is PNG:
        return Told(pixels=_check_png(head, bounds))
    if media is JPEG:
        return Told(pixels=_check_jpeg(head, bounds))
    if media is PLY and not _has_bare_returns(head):
        return Told(points=_check_ply(head, size_bytes, bounds))
    if media is PCD:
        return Told(points=_check_pcd(head, size_bytes, bounds))
    if media is LAS:
        return Told(points=_las_points(head))
    return Told()


def _las_points(head: bytes) -> int | None:
    """Return the number of records, of up to version 1.3 or from 1.4 on (LAS 1.4 R15, 2.4)."""
    if len(head) >= 255 and head[25] >= 4:
        return int.from_bytes(head[247:255], "little")
    return int.from_bytes(head[107:111], "little") if len(head) >= 111 else None


def _check_png(head: bytes, bounds: Bounds) -> int:
    """Read IHDR, which every PNG begins with (PNG third edition, 11.2.1)."""
    if len(head) < 33:
        raise FileTruncated("The PNG image ends within its header; upload it again.")
    width, height = struct.unpack(">II", head[16:24])
    if head[12:16] != b"IHDR":
        raise FileMalformed("The PNG image does not begin with its IHDR chunk.")
    return _check_pixels(width, height, bounds)


def _check_jpeg(head: bytes, bounds: Bounds) -> int | None:
    """Walk the segments to the frame header, as far as the first bytes go (ITU T.81, B.2.2)."""
    at = 2
    while at + 9 <= len(head) and head[at] == 0xFF:
        marker, length = head[at + 1], int.from_bytes(head[at + 2 : at + 4], "big")
        if marker in _SOF:
            height, width = struct.unpack(">HH", head[at + 5 : at + 9])
            # a height of 0: a DNL marker after the first scan tells
            return _check_pixels(width, height, bounds) if height else None
        if length < 2:
            return None
        at += 2 + length
    return None


def _check_pixels(width: int, height: int, bounds: Bounds) -> int:
    if width == 0 or height == 0:
        raise FileEmpty(f"The image has {width} x {height} pixels.")
    if width * height > bounds.max_pixels:
        raise ImageTooLarge(
            f"The image has {width} x {height} pixels; at most {bounds.max_pixels} are read."
            " Export the sheet at a lower resolution.",
            width_px=width,
            height_px=height,
            max_pixels=bounds.max_pixels,
        )
    return width * height


def _check_ply(head: bytes, size_bytes: int, bounds: Bounds) -> int:
    """Add up what the elements of fixed size need (Turk, The PLY Polygon File Format, 1994)."""
    lines, body_at = _header_lines(head, b"end_header", size_bytes, name="PLY")
    is_ascii, need, counted, points = False, 0, 0, 0
    element, count, record = "", 0, 0
    for words in [*lines, ["element", "", "0"]]:
        if words[0] == "format":
            is_ascii = words[1:2] == ["ascii"]
        elif words[0] == "element" and len(words) == 3:
            need += count * record
            element, count, record = words[1], _count(words[2]), 0
            if element == "vertex":
                _check_points(count, bounds)
                counted, points = counted + 1, points + count
        elif words[0] == "property" and len(words) >= 3:
            width = 1 if words[1] == "list" else _PLY_BYTES.get(words[1], 1)
            record += 2 if is_ascii else width
    if counted == 0:
        raise FileMalformed("The PLY file has no element 'vertex', so no points.")
    _check_body(size_bytes - body_at, need - 1 if is_ascii else need, name="PLY")
    return points


def _check_pcd(head: bytes, size_bytes: int, bounds: Bounds) -> int | None:
    """Compare POINTS, SIZE and COUNT with the file's size (PCD file format v0.7)."""
    lines, body_at = _header_lines(head, b"DATA", size_bytes, name="PCD")
    entries = {words[0].upper(): words[1:] for words in lines}
    if "POINTS" not in entries:
        return None
    points = _count(" ".join(entries["POINTS"]))
    _check_points(points, bounds)
    sizes = [_count(word) for word in entries.get("SIZE", [])]
    counts = [_count(word) for word in entries.get("COUNT", [])] or [1] * len(sizes)
    if len(sizes) != len(counts):
        return points
    encoding = " ".join(entries.get("DATA", [])).lower()
    if encoding == "binary":
        need = points * sum(size * count for size, count in zip(sizes, counts, strict=True))
    else:
        need = 2 * points * sum(counts) - 1 if encoding == "ascii" else 8
    _check_body(size_bytes - body_at, need, name="PCD")
    return points


def _check_points(points: int, bounds: Bounds) -> None:
    if points == 0:
        raise FileEmpty("The point cloud's header promises no point.")
    if points > bounds.max_points:
        raise TooManyPoints(
            f"The header promises {points} points; at most {bounds.max_points} are read."
            " Thin the scan, or export it in parts.",
            points=points,
            max_points=bounds.max_points,
        )


def _check_body(body_bytes: int, need_bytes: int, *, name: str) -> None:
    if body_bytes < need_bytes:
        raise FileTruncated(
            f"The {name} file's header promises points that need {need_bytes} bytes or more; {body_bytes}"
            " follow it. The copy or the upload was cut short: send the whole file.",
            expected_bytes=need_bytes,
            found_bytes=body_bytes,
        )


def _header_lines(head: bytes, last: bytes, size_bytes: int, *, name: str) -> tuple[list[list[str]], int]:
    """Return the words of the header's lines, to the one that begins with `last`, and the body's offset."""
    lines, at = [], 0
    while True:
        end = head.find(b"\n", at)
        if end < 0:
            if size_bytes <= len(head):
                raise FileTruncated(f"The {name} file ends within its header; send the whole file.")
            raise FileMalformed(f"The {name} file's header does not end within {HEAD_BYTES} bytes.")
        words = head[at:end].decode("ascii", errors="replace").split()
        if words:
            lines.append(words)
        if words and words[0].upper() == last.decode().upper():
            return lines, end + 1
        at = end + 1


def _has_bare_returns(head: bytes) -> bool:
    """Return whether lines end in a carriage return alone, as on old Macs: left to the reader."""
    return head[3:4] == b"\r" and head[4:5] != b"\n"


def _count(word: str) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 20):
        raise FileMalformed(f"The header holds {word[:40]!r} where a whole number belongs.")
    return int(word)
