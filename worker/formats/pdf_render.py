"""A PDF page to pixels: at the resolution of its scan, within limits of pixels and of time."""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pypdfium2.raw as pdfium
from numpy.typing import NDArray

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex, FileMalformed
from service.domain.findings import Finding
from worker.geometry.drawing.raster.sheet import Sheet

_LEAST_DPI, _MOST_DPI = 36.0, 1200.0
_STRIP_ROWS = 512
_LONGEST_S = 60.0
_MOST_COLOUR_PIXELS = 120_000_000


def render_sheet(
    page: Any,
    *,
    size_mm: tuple[float, float],
    dpi: float,
    is_coloured: bool,
    bounds: Bounds,
    tell: Callable[[str, float], None],
) -> Sheet:
    """Return a page as a sheet of pixels.

    Parameters
    ----------
    page : FPDF_PAGE
        Open page.
    size_mm : tuple of float
        Width and height as displayed [mm].
    dpi : float
        Pixels an inch that are wanted; fewer are taken where the sheet would be too large.
    is_coloured : bool
        Whether the darkest of three channels is taken, so that a cyan pen is as good as a black one.
    bounds : Bounds
        `max_pixels` is the largest sheet.
    tell : callable
        Told the stage while pdfium draws; what it raises ends the work.

    Returns
    -------
    Sheet
        With its dpi, and a finding where it is coarser than was wanted.

    Raises
    ------
    DrawingTooComplex
        If drawing the page takes longer than a minute.
    FileMalformed
        If pdfium cannot draw it.
    """
    wide, high = (max(s, 1e-3) / 25.4 for s in size_mm)
    most = min(bounds.max_pixels, _MOST_COLOUR_PIXELS) if is_coloured else bounds.max_pixels
    wanted = min(max(dpi, _LEAST_DPI), _MOST_DPI)
    taken = min(wanted, math.sqrt(most / (wide * high)))
    columns, rows = max(1, int(wide * taken + 0.5)), max(1, int(high * taken + 0.5))
    grey = _drawn(page, (columns, rows), is_coloured=is_coloured, tell=tell)
    findings: tuple[Finding, ...] = ()
    if taken < wanted:
        findings = (
            Finding(
                "page-coarsened",
                "info",
                f"The page was read at {taken:.0f} dpi, not at the {wanted:.0f} dpi of its image, so that it "
                f"has no more than {most} pixels.",
                {"dpi": round(taken, 2), "image_dpi": round(wanted, 2)},
            ),
        )
    return Sheet(grey, dpi=rows / high, findings=findings)


def _drawn(
    page: Any, size: tuple[int, int], *, is_coloured: bool, tell: Callable[[str, float], None]
) -> NDArray[np.uint8]:
    columns, rows = size
    kind = pdfium.FPDFBitmap_BGR if is_coloured else pdfium.FPDFBitmap_Gray
    channels = 3 if is_coloured else 1
    pixels = np.zeros((rows, columns, channels), dtype=np.uint8)
    pixels.fill(255)
    where = pixels.ctypes.data_as(ctypes.c_void_p)
    bitmap = pdfium.FPDFBitmap_CreateEx(columns, rows, kind, where, columns * channels)
    if not bitmap:
        raise FileMalformed(
            f"The page cannot be drawn in {columns} x {rows} pixels; export it as a PNG image."
        )
    try:
        _draw(page, bitmap, size, tell)
    finally:
        pdfium.FPDFBitmap_Destroy(bitmap)
    if not is_coloured:
        return pixels[..., 0]
    grey = np.zeros((rows, columns), dtype=np.uint8)
    for top in range(0, rows, _STRIP_ROWS):
        grey[top : top + _STRIP_ROWS] = pixels[top : top + _STRIP_ROWS].min(axis=2)
    return grey


def _draw(page: Any, bitmap: Any, size: tuple[int, int], tell: Callable[[str, float], None]) -> None:
    """Let pdfium draw in slices of time, so that the work can be given up."""
    deadline = time.monotonic() + _LONGEST_S
    slice_ends = [time.monotonic() + 0.5]

    def must_pause(_this: Any) -> bool:
        return time.monotonic() > slice_ends[0]

    pause = pdfium.IFSDK_PAUSE(version=1)
    pause.NeedToPauseNow = type(pause.NeedToPauseNow)(must_pause)
    state = pdfium.FPDF_RenderPageBitmap_Start(bitmap, page, 0, 0, *size, 0, 0, pause)
    try:
        while state == pdfium.FPDF_RENDER_TOBECONTINUED:
            if time.monotonic() > deadline:
                raise DrawingTooComplex(
                    f"The page takes longer than {_LONGEST_S:.0f} s to draw; print it as a PNG image."
                )
            tell("load", 0.95)
            slice_ends[0] = time.monotonic() + 0.5
            state = pdfium.FPDF_RenderPage_Continue(page, pause)
    finally:
        pdfium.FPDF_RenderPage_Close(page)
    if state != pdfium.FPDF_RENDER_DONE:
        raise FileMalformed("The page cannot be drawn; export it as a PNG image.")
