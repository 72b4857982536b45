"""Damage to a right file, the same for the same seed: what discs, networks, bad programs and attackers do."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

from service.domain.media import HEAD_BYTES, recognise
from tests.hostile import drawings, scans

MOST_BYTES = 2 << 20
"""No damaged file is larger."""

_HEAD = 600
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_INTEGERS = (
    0,
    1,
    -1,
    2,
    127,
    255,
    256,
    32767,
    65535,
    65536,
    1 << 20,
    50_000_000,
    (1 << 31) - 1,
    1 << 31,
    -(1 << 31),
)
_FLOATS = (0.0, -0.0, 1e-300, 1e-30, 1e4, 1e7, 1e10, 1e20, 1e38, 1e154, 1e300, float("nan"), float("inf"))
_WORDS = (
    b"0", b"-1", b"1", b"2", b"7", b"65536", b"50000000", b"2147483648", b"4294967295",
    b"99999999999999999999", b"1e7", b"1e20", b"1e154", b"1e308", b"1e999", b"-1e154", b"1e-300",
    b"nan", b"inf", b"", b"x", b"0x10", b"1,5",
)  # fmt: skip


def flip(content: bytes, rng: Random) -> bytes:
    """Return the file with 1 to 64 bits turned over, half of the time in its head alone."""
    out = bytearray(content)
    reach = min(len(out), _HEAD) if rng.random() < 0.5 else len(out)
    for _ in range(1 << rng.randrange(7)):
        out[rng.randrange(reach)] ^= 1 << rng.randrange(8)
    return bytes(out)


def cut(content: bytes, rng: Random) -> bytes:
    """Return the file without its end; half of the time its last bytes, where an end is marked, are kept."""
    at = rng.randrange(len(content))
    kept = rng.choice((0, 8, 64, 512)) if rng.random() < 0.5 else 0
    return content[:at] + content[max(at, len(content) - kept) :]


def lie(content: bytes, rng: Random) -> bytes:
    """Return the file with a few numbers of its head (or anywhere) put to the edges of what a field holds."""
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        reach = min(len(out), _HEAD) if rng.random() < 0.7 else len(out)
        value = _packed(rng)
        at = rng.randrange(max(1, reach - len(value)))
        out[at : at + len(value)] = value
    return bytes(out)


def _packed(rng: Random) -> bytes:
    order = rng.choice("<>")
    if rng.random() < 0.3:
        value, code = rng.choice(_FLOATS), rng.choice("fd")
        return struct.pack(order + code, value if code == "d" or not 1e38 < value < 1e301 else 1e38)
    code = rng.choice("BHIQ")
    bits = 8 * struct.calcsize(code)
    return struct.pack(order + code, rng.choice(_INTEGERS) % (1 << bits))


def digits(content: bytes, rng: Random) -> bytes:
    """Return the file with 1 to 16 of the numbers that are written as text replaced, or a digit of them."""
    for _ in range(1 << rng.randrange(5)):
        found = list(_NUMBER.finditer(content))
        if not found:
            return flip(content, rng)
        few = found[:60] if rng.random() < 0.5 else found
        at = rng.choice(few)
        if rng.random() < 0.4:
            number = bytearray(at[0])
            number[rng.randrange(len(number))] = rng.choice(b"0123456789.-+eE")
            content = content[: at.start()] + bytes(number) + content[at.end() :]
        else:
            content = content[: at.start()] + rng.choice(_WORDS) + content[at.end() :]
    return content


def repeat(content: bytes, rng: Random) -> bytes:
    """Return the file with a piece of it repeated 2 to 4,096 times."""
    start, end = _piece(content, rng)
    times = min(1 << rng.randrange(1, 13), max(1, (MOST_BYTES - len(content)) // (end - start)))
    return content[:end] + content[start:end] * times + content[end:]


def remove(content: bytes, rng: Random) -> bytes:
    """Return the file without one to four pieces out of its middle."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        if len(content) > 1:
            start, end = _piece(content, rng)
            content = content[:start] + content[end:]
    return content


def swap(content: bytes, rng: Random) -> bytes:
    """Return the file with a piece overwritten by another of its pieces, or by noise."""
    start, end = _piece(content, rng)
    at = rng.randrange(len(content))
    piece = content[start:end] if rng.random() < 0.7 else rng.randbytes(end - start)
    return content[:at] + piece + content[at + len(piece) :]


def _piece(content: bytes, rng: Random) -> tuple[int, int]:
    """Return where a piece begins and ends; lines are taken whole where there are some, half of the time."""
    if rng.random() < 0.5 and content.count(b"\n") > 4:
        ends = [m.end() for m in re.finditer(rb"\n", content)]
        first = rng.randrange(len(ends) - 1)
        last = min(len(ends) - 1, first + rng.choice((1, 1, 2, 4, 16)))
        return ends[first], ends[last]
    size = min(1 << rng.randrange(11), len(content))
    start = rng.randrange(len(content) - size + 1)
    return start, start + size


DAMAGES: dict[str, Callable[[bytes, Random], bytes]] = {
    "flip": flip, "cut": cut, "lie": lie, "digits": digits, "repeat": repeat, "remove": remove, "swap": swap,
}  # fmt: skip
"""What damages a file, by its name."""

FORMATS: dict[str, tuple[str, Callable[[], bytes]]] = {
    **{name: ("drawings", make) for name, make in drawings.MAKERS.items()},
    **{name: ("scans", make) for name, make in scans.MAKERS.items()},
}
"""The collection that a file is uploaded to, and what makes a right one, by the name of its kind."""


def _resealed_png(content: bytes) -> bytes:
    """Return a PNG with the checksums of its chunks made right, as far as it can be followed."""
    out, at = bytearray(content), 8
    while at + 12 <= len(out):
        end = at + 8 + int.from_bytes(out[at : at + 4], "big")
        if end + 4 > len(out):
            break
        out[end : end + 4] = struct.pack(">I", zlib.crc32(out[at + 4 : end]))
        at = end + 4
    return bytes(out)


RESEAL: dict[str, Callable[[bytes], bytes]] = {
    "png": _resealed_png,
    "palette.png": _resealed_png,
    "e57": scans.resealed_e57,
}
"""What makes checksums right again after a damage, so that readers look further than at these."""

_made: dict[str, bytes] = {}


def right(kind: str) -> bytes:
    """Return the right file of a kind."""
    if kind not in _made:
        _made[kind] = FORMATS[kind][1]()
    return _made[kind]


def damaged(kind: str, damage: str, seed: int) -> bytes:
    """Return the file of a kind with a damage: the same bytes for the same seed."""
    rng = Random(f"{kind}/{damage}/{seed}")  # seeded by a text: the same on every machine
    content = DAMAGES[damage](right(kind), rng)[:MOST_BYTES]
    return RESEAL[kind](content) if kind in RESEAL and rng.random() < 0.7 else content


def case(seed: int, kinds: Sequence[str] = tuple(FORMATS)) -> tuple[str, str]:
    """Return the kind and the damage of a seed: as many seeds as there are pairs meet each pair once."""
    pairs = [(kind, damage) for damage in DAMAGES for kind in kinds]
    return pairs[seed % len(pairs)]


def add_right_files(folder: Path) -> list[str]:
    """Return the kinds that the files of a folder, right ones and of a size to damage, make from now on."""
    kinds = []
    for path in sorted(folder.iterdir()):
        content = path.read_bytes() if path.is_file() and path.stat().st_size <= MOST_BYTES else b""
        purpose = recognise(content[:HEAD_BYTES]).fits
        if purpose is not None:
            _made[path.name] = content
            FORMATS[path.name] = (f"{purpose}s", lambda content=content: content)
            kinds.append(path.name)
    return kinds
