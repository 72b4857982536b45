"""The texts of a PDF page with place, height and angle; also those that AutoCAD hides in annotations."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator, Mapping
from ctypes import byref
from typing import Any

import pypdfium2.raw as pdfium

from service.domain.errors import DrawingTooComplex
from worker.formats.pdf_objects import Affine, compose, moved
from worker.formats.pdf_weight import LETTERS_PER_TEXT
from worker.formats.text_runs import TextRun, join_runs
from worker.geometry.drawing.text import Text

_SHX = "AutoCAD SHX Text"
_MOST_LETTERS = 4096


def page_texts(page: Any, T_mm_user: Affine, *, layers: Mapping[int, str], most: int) -> tuple[Text, ...]:
    """Return the texts of a page, joined to lines.

    Parameters
    ----------
    page : FPDF_PAGE
        Open page.
    T_mm_user : tuple of float
        Takes its user space to the displayed frame [mm], y up.
    layers : mapping of int to str
        The layer of a text object, by its address.
    most : int
        Texts that are taken at most.

    Returns
    -------
    tuple of Text
        In mm of paper, as displayed.

    Raises
    ------
    DrawingTooComplex
        If the page has more letters than 20 times `most`.
    """
    text_page = pdfium.FPDFText_LoadPage(page)
    if not text_page:
        return ()
    try:
        count = pdfium.FPDFText_CountChars(text_page)
        if count > LETTERS_PER_TEXT * most:
            raise DrawingTooComplex(
                f"The page holds {count} letters; at most {LETTERS_PER_TEXT * most} are read. "
                "Upload the sheet with the floor plan alone.",
                max_letters=LETTERS_PER_TEXT * most,
            )
        runs = list(_runs(text_page, count, T_mm_user, layers))
    finally:
        pdfium.FPDFText_ClosePage(text_page)
    return join_runs([*runs, *_annotations(page, T_mm_user, most=most)])


def _runs(text_page: Any, count: int, T: Affine, layers: Mapping[int, str]) -> Iterator[TextRun]:
    """Yield a run for each text object, in the order of the page."""
    letters: list[str] = []
    start = last = owner = 0
    for i in range(count):
        code = pdfium.FPDFText_GetUnicode(text_page, i)
        if code in {0, 10, 13, 0xFFFE, 0xFFFF} or pdfium.FPDFText_IsGenerated(text_page, i) == 1:
            continue
        found = ctypes.cast(pdfium.FPDFText_GetTextObject(text_page, i), ctypes.c_void_p).value or 0
        if found != owner and letters:
            yield _run(text_page, (start, last), "".join(letters), T, layers.get(owner, ""))
            letters = []
        if not letters:
            start, owner = i, found
        letters.append(chr(code))
        last = i
    if letters:
        yield _run(text_page, (start, last), "".join(letters), T, layers.get(owner, ""))


def _run(text_page: Any, span: tuple[int, int], text: str, T: Affine, layer: str) -> TextRun:
    start, last = span
    m = pdfium.FS_MATRIX()
    pdfium.FPDFText_GetMatrix(text_page, start, byref(m))
    own = compose((m.a, m.b, m.c, m.d, m.e, m.f), T)
    size = pdfium.FPDFText_GetFontSize(text_page, start) * math.hypot(own[2], own[3])
    angle = math.atan2(own[1], own[0])
    x, y = ctypes.c_double(), ctypes.c_double()
    pdfium.FPDFText_GetCharOrigin(text_page, start, byref(x), byref(y))
    begin = moved(T, x.value, y.value)
    left, right, bottom, top = (ctypes.c_double() for _ in range(4))
    pdfium.FPDFText_GetCharBox(text_page, last, byref(left), byref(right), byref(bottom), byref(top))
    middle = moved(T, (left.value + right.value) / 2, (bottom.value + top.value) / 2)
    cos, sin = math.cos(angle), math.sin(angle)
    length = (middle[0] - begin[0]) * cos + (middle[1] - begin[1]) * sin + 0.28 * size
    return TextRun(text, begin[0], begin[1], max(length, 0.0), size, angle, layer)


def _annotations(page: Any, T: Affine, *, most: int) -> Iterator[TextRun]:
    """Yield what AutoCAD draws with stroke fonts: the letters stand in annotations beside the strokes."""
    for i in range(min(pdfium.FPDFPage_GetAnnotCount(page), most)):
        note = pdfium.FPDFPage_GetAnnot(page, i)
        try:
            if _value(note, b"T") == _SHX:
                text = _value(note, b"Contents").strip()
                box = pdfium.FS_RECTF()
                if text and pdfium.FPDFAnnot_GetRect(note, byref(box)):
                    yield _boxed(text, moved(T, box.left, box.bottom), moved(T, box.right, box.top))
        finally:
            pdfium.FPDFPage_CloseAnnot(note)


def _value(note: Any, key: bytes) -> str:
    held = (ctypes.c_ushort * _MOST_LETTERS)()
    size = pdfium.FPDFAnnot_GetStringValue(note, key, held, ctypes.sizeof(held))
    return bytes(held)[: min(size, ctypes.sizeof(held))].decode("utf-16-le", "replace").rstrip("\0")


def _boxed(text: str, a: tuple[float, float], b: tuple[float, float]) -> TextRun:
    """Return a text that fills a box; where the box stands upright, the text reads upwards."""
    left, right = sorted((a[0], b[0]))
    bottom, top = sorted((a[1], b[1]))
    wide, high = right - left, top - bottom
    if high > wide and len(text) > 1:
        return TextRun(text, right, bottom, high, wide / 0.72, math.pi / 2)
    return TextRun(text, left, bottom, wide, high / 0.72)
