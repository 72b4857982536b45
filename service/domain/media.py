"""What an uploaded file is, told by its own first bytes and never by its name."""

from __future__ import annotations

import re
import struct

from service.domain.errors import FileEmpty, UnsupportedMedia
from service.domain.formats import (
    BMP,
    BUILDING_YAML,
    DXF,
    FORMATS,
    IFC,
    OBJ,
    PCD,
    PDF,
    PGM,
    ROS_MAP,
    ROS_MAP_ZIP,
    STL,
    SVG,
    USDZ,
    WEBP,
    XYZ,
    Media,
    Purpose,
    listed,
)

HEAD_BYTES = 1 << 16
"""How much of a file is looked at here; what a reader needs beyond that, its job finds."""

_WHITE = b" \t\r\n\xef\xbb\xbf"
_OBJ = re.compile(rb"(?:\s*(?:#[^\n]*)?\n)*\s*(?:mtllib|usemtl|o|g|v|vn|vt)[ \t]")
_NUMBER = rb"[-+]?(?:\d+(?:\.\d*)?|\.\d+|nan|inf)(?:e[-+]?\d+)?"
_NUMBERS = re.compile(rb"\s*" + _NUMBER + rb"(?:[ \t,;]+" + _NUMBER + rb"){2,}", re.IGNORECASE)
_AXES = tuple(re.compile(rb"\b" + axis + rb"(?:_m)?\b", re.IGNORECASE) for axis in (b"x", b"y", b"z"))
_MOST_HEADER_LINES = 20
_STL_TEXT = re.compile(rb"solid[^\n]*\n\s*(?:facet|endsolid)\b", re.IGNORECASE)
_STL_RECORD_BYTES = 50
_PCD = re.compile(rb"\s*(?:#[^\n]*\n\s*)*(?:VERSION|FIELDS|COLUMNS)[ \t]", re.IGNORECASE)
_DXF = re.compile(rb"\s*(?:999\r?\n[^\n]*\n\s*)*0[ \t]*\r?\n\s*SECTION\s")
_PGM = re.compile(rb"P[25]\s+(?:#[^\n]*\n\s*)*\d")
_ROS_MAP = re.compile(rb"^resolution[ \t]*:", re.MULTILINE)
_ROS_IMAGE = re.compile(rb"^image[ \t]*:", re.MULTILINE)
_BY_THE_WAY = re.compile(rb"/$|(?:^|/)(?:__MACOSX/|\.)", re.IGNORECASE)
_LEVELS = re.compile(rb"^levels[ \t]*:", re.MULTILINE)

_UNPACK = (
    "Archives are not read, but for a ZIP of a ROS map (map.yaml and its image): unpack it and upload the "
    "drawing or the scan alone."
)
_EXPORT_IMAGE = "Images of this kind are not read: save it as PNG."

_ZIP = Media("a ZIP archive (or a DOCX, XLSX or 3MF file)", "application/zip", advice=_UNPACK)
_TEXT = Media("a text file", "text/plain", advice="It is neither a drawing nor a scan.")
_UNKNOWN = Media("of no kind that is known here", "application/octet-stream", advice="")

_UNREAD: tuple[tuple[bytes, Media], ...] = (
    (b"PK\x05\x06", _ZIP),
    (b"7z\xbc\xaf\x27\x1c", Media("a 7z archive", "application/x-7z-compressed", advice=_UNPACK)),
    (b"Rar!\x1a\x07", Media("a RAR archive", "application/vnd.rar", advice=_UNPACK)),
    (b"\x1f\x8b", Media("a gzip archive", "application/gzip", advice=_UNPACK)),
    (b"GIF8", Media("a GIF image", "image/gif", advice=_EXPORT_IMAGE)),
    (b"8BPS", Media("a Photoshop image", "image/vnd.adobe.photoshop", advice=_EXPORT_IMAGE)),
)
_MAGIC = tuple((magic, media) for media in FORMATS for magic in media.begins) + _UNREAD
_HTML = Media("a web page", "text/html", advice="The download may have saved an error page instead.")
_HEIC = Media("a HEIC, AVIF or MP4 file", "image/heic", advice=_EXPORT_IMAGE)


def recognise(head: bytes) -> Media:
    """Return what a file is whose first bytes are `head`; never refuses.

    A recognised beginning does not tell that the rest is whole or right: that the file's job finds out.

    Parameters
    ----------
    head : bytes
        The first `HEAD_BYTES` of the file, or all of a smaller one.

    Examples
    --------
    >>> recognise(b"%PDF-1.7 and so on").name
    'a PDF document'
    """
    for magic, media in _MAGIC:
        if head.startswith(magic):
            return media
    contained = _recognise_container(head)
    if contained is not None:
        return contained
    if _is_text(head):
        return _recognise_text(head)
    return STL if _is_binary_stl(head) else _UNKNOWN


def _recognise_container(head: bytes) -> Media | None:
    if head.startswith(b"PK\x03\x04"):
        return _recognise_zip(head)
    if head[:2] == b"BM" and head[6:10] == bytes(4):
        return BMP
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return WEBP
    if head[4:8] == b"ftyp":
        return _HEIC
    return PGM if _PGM.match(head[:4096]) else None


def accept(head: bytes, purpose: Purpose) -> Media:
    """Return what the file is, if it can be uploaded for the purpose.

    Raises
    ------
    FileEmpty
        If `head` holds nothing.
    UnsupportedMedia
        If files of this kind are not read, or belong to another purpose.
    """
    if not head:
        raise FileEmpty("The file has no bytes; look at it where it comes from, and upload it again.")
    media = recognise(head)
    if media.fits is purpose:
        return media
    taken = listed(purpose)
    advice = media.advice or f"A {purpose} is taken as one of: {taken}."
    if media.fits is not None:
        advice = f"Upload it as a {media.fits}, or take another file: {purpose}s are {taken}."
    raise UnsupportedMedia(
        f"By its own bytes the file is {media.name}, whatever its name says. {advice}",
        found=media.media_type,
        purpose=str(purpose),
    )


def _is_text(head: bytes) -> bool:
    if not head or b"\0" in head:
        return False
    control = sum(byte < 32 and byte not in b"\t\n\f\r\x1b" for byte in head[:4096])
    return control == 0


def _recognise_text(head: bytes) -> Media:
    start = head.lstrip(_WHITE)
    lower = start[:1024].lower()
    if lower.startswith((b"<!doctype html", b"<html")):
        return _HTML
    for is_it, media in (
        (start.startswith(b"<") and b"<svg" in start.lower(), SVG),
        (b"%pdf-" in lower, PDF),
        (start.startswith(b"ISO-10303-21;"), IFC),
    ):
        if is_it:
            return media
    for pattern, media in ((_PCD, PCD), (_DXF, DXF), (_OBJ, OBJ), (_STL_TEXT, STL)):
        if pattern.match(start[:4096]):
            return media
    if _is_point_list(start[:4096]):
        return XYZ
    return _recognise_yaml(start)


def _is_point_list(start: bytes) -> bool:
    """Whether a row of three numbers comes first, or after remarks, a count and a line of names."""
    for line in start.splitlines()[: _MOST_HEADER_LINES + 1]:
        if _NUMBERS.match(line):
            return True
        text = line.strip().strip(b'"')
        if text and not (text.startswith((b"#", b"//")) or text.isdigit() or _names_axes(text)):
            return False
    return False


def _names_axes(line: bytes) -> bool:
    return all(axis.search(line) for axis in _AXES)


def _is_binary_stl(head: bytes) -> bool:
    """Whether triangles follow a header of 84 bytes, by their normals: the format has no magic number."""
    count = int.from_bytes(head[80:84], "little")
    seen = min(count, (len(head) - 84) // _STL_RECORD_BYTES, 8)
    if seen < 1:
        return False
    for at in range(84, 84 + seen * _STL_RECORD_BYTES, _STL_RECORD_BYTES):
        x, y, z = struct.unpack("<3f", head[at : at + 12])
        length = x * x + y * y + z * z
        if not (length == 0.0 or 0.9 < length < 1.1):
            return False
    return True


def _recognise_yaml(start: bytes) -> Media:
    if _ROS_IMAGE.search(start) and _ROS_MAP.search(start):
        return ROS_MAP
    return BUILDING_YAML if _LEVELS.search(start) else _TEXT


def _recognise_zip(head: bytes) -> Media:
    """Return what a ZIP holds by the names in its first local headers (APPNOTE 4.3.7)."""
    names = [name.lower() for name in _names_in(head) if not _BY_THE_WAY.search(name)]
    if names and names[0].endswith((b".usdc", b".usda", b".usd")):
        return USDZ
    if any(name.endswith((b".yaml", b".yml", b".pgm")) for name in names):
        return ROS_MAP_ZIP
    return ROS_MAP_ZIP if names and names[0].endswith((b".png", b".bmp")) else _ZIP


def _names_in(head: bytes) -> list[bytes]:
    """Return the names of the entries whose headers lie in the first bytes, whatever lies between them."""
    names: list[bytes] = []
    at = head.find(b"PK\x03\x04")
    while at >= 0 and len(names) < 64:
        length = int.from_bytes(head[at + 26 : at + 28], "little")
        names.append(head[at + 30 : at + 30 + length])
        at = head.find(b"PK\x03\x04", at + 4)
    return names
