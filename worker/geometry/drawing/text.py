"""Text on a drawing: as a vector file states it, or as it was recognised on a sheet."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Text:
    """Hold one line of text and where it stands.

    Parameters
    ----------
    text : str
        What it says.
    x, y : float
        Middle of the text: pixels of the sheet (y down), or drawing units (y up).
    height : float
        Height of its capital letters, in the same unit.
    angle : float
        Direction of reading against the x axis [rad], counter-clockwise as one sees it.
    layer : str
        The file's layer, empty where it has none.
    confidence : float
        1 for text of a vector file; else how sure the recogniser was.
    """

    text: str
    x: float
    y: float
    height: float
    angle: float = 0.0
    layer: str = ""
    confidence: float = 1.0
