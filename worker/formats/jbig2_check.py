"""A JBIG2 stream of a PDF held against its own segments and its image's height."""

from __future__ import annotations

import struct

from service.domain.errors import FileTruncated

_LEAST, _HEADER = 11, 6
_PAGE = 48
_LONG = 7
_UNKNOWN = 0xFFFFFFFF


def check_jbig2(data: bytes, *, height: int, name: str) -> None:
    """Refuse an image, called by this name and of this height, whose segments are not all there.

    Raises
    ------
    FileTruncated
        If the data end within a segment, or its page has fewer rows than the image.

    Notes
    -----
    ITU-T T.88, 7.2: a segment's header has its number, its type, the segments that it refers to, its page and
    the length of its data, which follow; of an immediate region that may be unknown, then the rest is its.
    """
    at = 0
    while at + _LEAST <= len(data):  # a line end may stand behind the last
        kind, begin, size = _segment(data, at)
        if size is None or begin + size > len(data):
            raise FileTruncated(
                f"{name} is cut short: its data end within a segment of JBIG2. Export the document anew."
            )
        if kind == _PAGE and size >= 2 * 4:
            (rows,) = struct.unpack_from(">I", data, begin + 4)
            if rows < height:
                raise FileTruncated(
                    f"{name} holds {rows} rows of pixels, and its header says {height}. Export the document "
                    "anew."
                )
        at = begin + size


def _segment(data: bytes, at: int) -> tuple[int, int, int | None]:
    """Return a segment's type, where its data begin, and their size, None where its header is cut."""
    try:
        number, flags, count = struct.unpack_from(">IBB", data, at)
        at += _HEADER - 1
        referred = count >> 5
        if referred == _LONG:
            referred = struct.unpack_from(">I", data, at)[0] & 0x1FFFFFFF
            at += 4 + (referred + 8) // 8
        else:
            at += 1
        at += referred * (1 if number <= 256 else 2 if number <= 65536 else 4)
        at += 4 if flags & 0x40 else 1
        (size,) = struct.unpack_from(">I", data, at)
    except struct.error:
        return 0, at, None
    at += 4
    return flags & 0x3F, at, max(0, len(data) - at) if size == _UNKNOWN else size
