"""A sheet of pixels: a scanned or exported drawing, before anything is read from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.domain.findings import Finding
from worker.geometry.drawing.scale.decision import Witness
from worker.geometry.drawing.text import Text


@dataclass(frozen=True, eq=False)
class Sheet:
    """Hold the pixels of a drawing and what its file states beside them.

    Parameters
    ----------
    grey : ndarray of shape (H, W), uint8
        255 is bare paper; row 0 is the top of the sheet as uploaded.
    dpi : float, optional
        Pixels an inch of paper, where the file states it (a PDF page always does).
    texts : tuple of Text
        What the file itself says in letters (a scanned PDF with a text layer), in pixels, y down.
    witnesses : tuple of Witness
        What the file states of its scale (a PDF's measure dictionary, a ROS map's resolution) [m a pixel].
    findings : tuple of Finding
        Remarks of the loader: another page, a rotated sheet, colour inks.
    """

    grey: NDArray[np.uint8]
    dpi: float | None = None
    texts: tuple[Text, ...] = ()
    witnesses: tuple[Witness, ...] = ()
    findings: tuple[Finding, ...] = ()
