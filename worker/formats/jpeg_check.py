"""A JPEG's data held against its header: what is missing or broken in them, which decoders paint over."""

from __future__ import annotations

import simplejpeg

from service.domain.errors import FileTruncated
from service.domain.findings import Finding

_HUFFMAN_FRAMES = (0xC0, 0xC1, 0xC2)
_ALONE = (0x01, *range(0xD0, 0xD9))
_START_OF_SCAN = 0xDA
_BLOCK_PIXELS = 64
_COARSEST = 8
_WARNINGS = ("Corrupt JPEG data", "Inconsistent progression")


def check_jpeg(content: bytes, *, name: str) -> tuple[Finding, ...]:
    """Return what is wrong with an image, called by this name, whose pixels can all be decoded.

    libjpeg paints grey over what is missing, and goes on behind broken places: it calls both a warning, which
    Pillow and OpenCV swallow. Here the data are decoded once more, at an eighth of the size, and every
    warning counts.

    Raises
    ------
    FileTruncated
        If the data end before the header's last pixel, whatever end mark follows.

    Notes
    -----
    A block of 8 x 8 pixels takes one bit or more, if it is coded by Huffman (ITU-T T.81, annexes F and G):
    a file that is too small for its header is refused before a decoder takes memory for it.
    """
    frame = _frame(content)
    if frame is not None:
        kind, width, height = frame
        least = width * height // _BLOCK_PIXELS // 8
        if kind in _HUFFMAN_FRAMES and len(content) < least:
            raise FileTruncated(
                f"{name} is cut short: {width} x {height} pixels need {least} bytes or more, and it has "
                f"{len(content)}. Upload it again.",
                width=width,
                height=height,
            )
    try:
        simplejpeg.decode_jpeg(content, colorspace="GRAY", min_factor=_COARSEST, strict=True)
    except ValueError as error:
        return _judged(str(error), name)
    return ()


def _judged(said: str, name: str) -> tuple[Finding, ...]:
    """Return what a refusal to decode strictly means: what cannot be decoded at all, Pillow says itself."""
    if "premature end" in said.lower():
        raise FileTruncated(
            f"{name} holds fewer pixels than its header says ({said}): it is cut short, or damaged in "
            "its middle. Upload it again."
        )
    if not said.startswith(_WARNINGS):
        return ()
    message = f"The image's data are damaged ({said}): parts of it may be grey, shifted or missing."
    return (Finding("pixels-damaged", "warning", message),)


def _frame(content: bytes) -> tuple[int, int, int] | None:
    """Return the frame's marker, width and height (ITU-T T.81, B.2.2); None where there is no frame."""
    at = 2
    while at + 9 <= len(content) and content[at] == 0xFF:
        marker = content[at + 1]
        if marker == 0xFF or marker in _ALONE:
            at += 1 if marker == 0xFF else 2
        elif marker == _START_OF_SCAN:
            break
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = (int.from_bytes(content[at + k : at + k + 2], "big") for k in (5, 7))
            return marker, width, height
        else:
            at += 2 + max(2, int.from_bytes(content[at + 2 : at + 4], "big"))
    return None
