"""The pages of a TIFF file, read from its directories alone: no pixel is touched, every loop is bounded."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from service.domain.errors import FileMalformed, FileTruncated

_MOST_DIRECTORIES, _MOST_ENTRIES = 4096, 4096
_SUBFILE_TYPE, _WIDTH, _HEIGHT, _COMPRESSION, _TILE_WIDTH, _TILE_HEIGHT = 254, 256, 257, 259, 322, 323
_WANTED = (_SUBFILE_TYPE, _WIDTH, _HEIGHT, _COMPRESSION, _TILE_WIDTH, _TILE_HEIGHT)
_FAX, _JPEG = (2, 3, 4), 7
_REDUCED_OR_MASK = 0b101
_NUMBERS = {1: "B", 3: "H", 4: "I", 16: "Q"}


@dataclass(frozen=True)
class TiffPage:
    """Hold one full page of a TIFF.

    Parameters
    ----------
    directory : int
        Index of its directory in the file, from 0; thumbnails and masks in between are counted here.
    width, height : int
        As stored, before any orientation [px].
    tile_pixels : int
        Pixels of one tile, 0 where the page is stored in strips.
    compression : int
        Tag 259; 1 is none.
    """

    directory: int
    width: int
    height: int
    tile_pixels: int
    compression: int = 1

    @property
    def least_bytes(self) -> int:
        """Return the fewest bytes that its pixels can be packed to, where libtiff paints over missing ones.

        A bit for each row of a fax (ITU-T T.4, T.6), and for each 8 x 8 block of a JPEG (ITU-T T.81).
        """
        if self.compression in _FAX:
            return self.height // 8
        return self.width * self.height // (8 * 8) // 8 if self.compression == _JPEG else 0


def list_tiff_pages(path: Path) -> tuple[TiffPage, ...]:
    """Return the pages of a classic or a big TIFF in their order, without thumbnails and masks.

    Raises
    ------
    FileTruncated
        If a directory lies beyond the end of the file.
    FileMalformed
        If the directories go in a circle, are too many, or name no page.

    Notes
    -----
    TIFF 6.0, section 2; BigTIFF as in libtiff. At most 4096 directories of at most 4096 entries are walked.
    """
    with path.open("rb") as file:
        walk = _Walk.begin(file, path)
        pages: list[TiffPage] = []
        seen: set[int] = set()
        at = walk.first
        while at:
            if at in seen or len(seen) >= _MOST_DIRECTORIES:
                raise FileMalformed(
                    f"{path.name} has page directories that go in a circle, or more than "
                    f"{_MOST_DIRECTORIES}; save its pages anew."
                )
            seen.add(at)
            tags, at = walk.directory(at)
            if not tags.get(_SUBFILE_TYPE, 0) & _REDUCED_OR_MASK:
                size = (tags.get(_WIDTH, 0), tags.get(_HEIGHT, 0))
                tile = tags.get(_TILE_WIDTH, 0) * tags.get(_TILE_HEIGHT, 0)
                pages.append(TiffPage(len(seen) - 1, *size, tile, tags.get(_COMPRESSION, 1)))
    if not pages:
        raise FileMalformed(f"{path.name} has no page; export the drawing anew.")
    return tuple(pages)


@dataclass(frozen=True)
class _Walk:
    """Hold an open TIFF, its byte order, and where its first directory lies."""

    file: BinaryIO
    name: str
    order: str
    is_big: bool
    first: int

    @classmethod
    def begin(cls, file: BinaryIO, path: Path) -> _Walk:
        head = file.read(16)
        order = "<" if head[:2] == b"II" else ">"
        is_big = head[2:4] in (b"+\x00", b"\x00+")
        form, at = ("Q", 8) if is_big else ("I", 4)
        if len(head) < at + struct.calcsize(form):
            raise FileTruncated(f"{path.name} ends within its header; upload it again.")
        return cls(file, path.name, order, is_big, struct.unpack_from(order + form, head, at)[0])

    def directory(self, at: int) -> tuple[dict[int, int], int]:
        """Return the wanted tags of a directory, and the byte offset of the next one, 0 at the end."""
        count_form, pointer, entry = ("Q", "Q", 20) if self.is_big else ("H", "I", 12)
        if at >= 1 << 62:
            raise FileMalformed(f"{self.name} has a page directory at byte {at}; save its pages anew.")
        self.file.seek(at)
        count = self._number(count_form)
        if count > _MOST_ENTRIES:
            raise FileMalformed(f"{self.name} has a page directory of {count} entries; save its pages anew.")
        body = self._read(count * entry)
        tags: dict[int, int] = {}
        for i in range(count):
            tag, kind = struct.unpack_from(self.order + "HH", body, i * entry)
            if tag in _WANTED and kind in _NUMBERS:
                value = i * entry + (12 if self.is_big else 8)
                if kind != 16 or self.is_big:
                    tags[tag] = struct.unpack_from(self.order + _NUMBERS[kind], body, value)[0]
        return tags, self._number(pointer)

    def _number(self, form: str) -> int:
        return int(struct.unpack(self.order + form, self._read(struct.calcsize(form)))[0])

    def _read(self, size: int) -> bytes:
        data = self.file.read(size)
        if len(data) < size:
            raise FileTruncated(f"{self.name} ends within its page directory; upload it again.")
        return data
