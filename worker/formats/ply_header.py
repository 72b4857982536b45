"""The text at the top of a polygon file (PLY): which elements follow, how many, and of which properties."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from service.domain.errors import FileMalformed, FileTruncated, UnsupportedMedia

_MAX_HEADER_BYTES = 65_536
_CODES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_FORMATS = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class PlyProperty:
    """Hold one property: its name, numpy's code of its values ("f4"), and of its length if it is a list."""

    name: str
    value_code: str
    length_code: str = ""

    @property
    def is_list(self) -> bool:
        """Return whether there are as many values as a number before them says."""
        return bool(self.length_code)

    @property
    def value_bytes(self) -> int:
        """Return the bytes of one value."""
        return int(self.value_code[1])

    @property
    def length_bytes(self) -> int:
        """Return the bytes of the length; zero for what is no list."""
        return int(self.length_code[1]) if self.is_list else 0


@dataclass(frozen=True)
class PlyElement:
    """Hold one element of the header: its name, how many, and its properties."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    def least_bytes(self, *, text: bool) -> int:
        """Return the fewest bytes that the body needs for this element."""
        if text:
            return 2 * self.count * len(self.properties)
        return self.count * sum(p.length_bytes or p.value_bytes for p in self.properties)


@dataclass(frozen=True)
class PlyHeader:
    """Hold what the text at the top of the file promises; `encoding` is "ascii", "<" or ">"."""

    encoding: str
    elements: tuple[PlyElement, ...]
    data_offset: int


def read_ply_header(path: Path) -> PlyHeader:
    """Return what a PLY file's header promises; nothing of it has been compared with the bytes yet.

    Raises
    ------
    FileTruncated, FileMalformed, UnsupportedMedia
        As `read_ply` does.
    """
    with path.open("rb") as file:
        return _read_header(file.read(_MAX_HEADER_BYTES))


def _read_header(head: bytes) -> PlyHeader:
    """Return the header parsed from the first bytes of the file."""
    if not head.startswith((b"ply\n", b"ply\r")):
        raise UnsupportedMedia("The file does not begin with the line 'ply'.")
    end = head.find(b"end_header")
    stop = head.find(b"\n", end)
    if end < 0 or stop < 0:
        if len(head) < _MAX_HEADER_BYTES:
            raise FileTruncated("The PLY file ends inside its header: no end_header line was found.")
        raise FileMalformed(f"No end_header within the first {_MAX_HEADER_BYTES} bytes of the PLY file.")
    encoding, elements = "", []
    properties: list[PlyProperty] = []
    for line in head[:end].decode("ascii", errors="replace").splitlines()[1:]:
        words = line.split()
        if not words or words[0] in {"comment", "obj_info"}:
            continue
        if words[0] == "format" and len(words) == 3 and words[1] in _FORMATS:
            encoding = _FORMATS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdigit():
            properties = []
            elements.append((words[1], int(words[2]), properties))
        elif words[0] == "property" and elements:
            properties.append(_property(words))
        else:
            raise FileMalformed(f"The PLY header holds a line that the format does not know: {line[:80]!r}.")
    if not encoding:
        raise FileMalformed("The PLY header names no format.")
    return PlyHeader(encoding, tuple(PlyElement(n, c, tuple(p)) for n, c, p in elements), stop + 1)


def _property(words: list[str]) -> PlyProperty:
    """Return one property line's meaning."""
    is_list = len(words) == 5 and words[1] == "list"
    codes = [_CODES.get(word, "") for word in (words[2:4] if is_list else words[1:2])]
    if len(words) != (5 if is_list else 3) or "" in codes or (is_list and codes[0].startswith("f")):
        raise FileMalformed(
            f"The PLY header holds a property that is not understood: {' '.join(words)[:80]!r}."
        )
    return PlyProperty(words[-1], codes[-1], codes[0] if is_list else "")
