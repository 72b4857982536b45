"""The scale of a sheet or page, with the texts that told it."""

from __future__ import annotations

from dataclasses import dataclass

from service.domain.findings import Finding
from worker.geometry.drawing.scale.decision import Scale
from worker.geometry.drawing.text import Text


@dataclass(frozen=True)
class SheetScale:
    """Hold the scale of a sheet, and the texts that were read on the way.

    Parameters
    ----------
    scale : Scale
        With everybody who was heard.
    texts : tuple of Text
        What was read with confidence, in pixels of the sheet, y down; the file's own texts are not repeated.
    findings : tuple of Finding
        That nothing could be read, that the sheet is not to scale, who disagrees.
    """

    scale: Scale
    texts: tuple[Text, ...] = ()
    findings: tuple[Finding, ...] = ()
