"""PDF documents byte by byte, so that a test says exactly what stands in them."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

FONT = b"<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>"


def pdf_bytes(objects: Sequence[bytes], *, trailer: bytes = b"") -> bytes:
    """Return a document of these objects, numbered from 1; the first is its catalogue."""
    out = bytearray(b"%PDF-1.7\n")
    offsets = []
    for number, body in enumerate(objects, 1):
        offsets.append(len(out))
        out += b"%d 0 obj\n" % number + body + b"\nendobj\n"
    start = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % o for o in offsets)
    out += b"trailer<</Size %d/Root 1 0 R%s>>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, trailer, start)
    return bytes(out)


def stream(content: bytes, head: bytes = b"", *, pack: bool = False) -> bytes:
    """Return a stream object, packed by Flate where asked for."""
    if pack:
        content, head = zlib.compress(content, 9), head + b"/Filter/FlateDecode"
    return b"<<%s/Length %d>>stream\n" % (head, len(content)) + content + b"\nendstream"


def one_page(
    content: bytes,
    *,
    page: bytes = b"/MediaBox[0 0 400 200]",
    resources: bytes = b"",
    catalogue: bytes = b"",
    more: Sequence[bytes] = (),
    pack: bool = False,
) -> bytes:
    """Return a document of one page; `more` are objects from number 6 on, 5 is the font ``/F``."""
    return pdf_bytes(
        [
            b"<</Type/Catalog/Pages 2 0 R%s>>" % catalogue,
            b"<</Type/Pages/Kids[3 0 R]/Count 1>>",
            b"<</Type/Page/Parent 2 0 R/Contents 4 0 R/Resources<</Font<</F 5 0 R>>%s>>%s>>"
            % (resources, page),
            stream(content, pack=pack),
            FONT,
            *more,
        ]
    )
