"""Sheets (paper space) of a DXF file, for a drawing whose model space is empty."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from ezdxf.document import Drawing
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.viewport import Viewport
from ezdxf.math import Matrix44

from worker.formats.dxf_parts import Drawn, Part, PartBuilder, Reference, Style
from worker.geometry.drawing.scale.decision import Witness
from worker.geometry.drawing.scale.title_block import stated_scales

Read = Callable[[Iterable[DXFGraphic]], Part]

_FRAME = Style("sheet frame", 0, math.nan, 0)


def sheet_part(doc: Drawing, read: Read, *, to_model: bool) -> Part | None:
    """Return what the fullest sheet shows, or None where all are empty.

    Parameters
    ----------
    doc : Drawing
        The document.
    read : callable
        Flattens entities to a part.
    to_model : bool
        Whether to place the sheet in the model, by its largest window on it, and to draw that window.
    """
    layouts = [doc.layout(name) for name in doc.layout_names() if name.casefold() != "model"]
    parts = [(read(layout), layout) for layout in layouts]
    parts = [(part, layout) for part, layout in parts if len(part.ends) or part.texts]
    if not parts:
        return None
    part, layout = max(parts, key=lambda one: len(one[0].ends) + len(one[0].texts))
    if not to_model:
        return part
    window = _window(layout)
    if window is None:
        return part
    ratio = _ratio(window)
    view, centre = window.dxf.view_center_point, window.dxf.center
    shift = (view.x - centre.x * ratio, view.y - centre.y * ratio, 0.0)
    matrix = Matrix44.scale(ratio) @ Matrix44.translate(*shift)
    builder = PartBuilder(most=len(part.ends) + 4)
    w, h = window.dxf.width * ratio / 2, window.dxf.height * ratio / 2
    corners = [(-w, -h), (w, -h), (w, h), (-w, h), (-w, -h)]
    builder.add([[(view.x + x, view.y + y) for x, y in corners]], Drawn("polyline", _FRAME, closed=True))
    builder.add_reference(Reference.of(part, matrix, _FRAME))
    return builder.finish()


def title_witness(doc: Drawing, sheet: Part, *, to_model: bool) -> list[Witness]:
    """Return the unit that a stated scale (1:100) and the window's own ratio say, paper being in millimetres.

    Of a sheet that is read in paper units, a stated scale says metres in a millimetre of paper.
    """
    stated = stated_scales(t.text for t in sheet.texts)
    if len({s.ratio for s in stated}) != 1:
        return []
    said = stated[0]
    ratio = 1.0
    if to_model:
        windows = [w for w in (_window(doc.layout(n)) for n in doc.layout_names() if n != "Model") if w]
        if not windows:
            return []
        ratio = _ratio(max(windows, key=_area))
    metres = said.ratio * 0.001 / ratio
    detail = f"The sheet says {said.text!r}, and a millimetre of paper shows {ratio:.6g} units."
    return [Witness("title-block", metres, metres, detail)]


def _window(layout: Iterable[DXFGraphic]) -> Viewport | None:
    """Return the largest window on the model, without the sheet's own main one."""
    windows = [v for v in layout if isinstance(v, Viewport) and v.dxf.get("id", 2) != 1]
    good = [v for v in windows if _area(v) > 0 and 0 < v.dxf.get("view_height", 0) < math.inf]
    return max((v for v in good if not _is_main(v)), key=_area, default=None)


def _is_main(window: Viewport) -> bool:
    """Return whether a window shows the sheet itself: the same place at the same size."""
    x, y, _ = window.dxf.view_center_point - window.dxf.center
    return abs(_ratio(window) - 1.0) < 1e-9 and math.hypot(x, y) < 1e-6 * float(window.dxf.height)


def _area(window: Viewport) -> float:
    return float(window.dxf.get("width", 0.0)) * float(window.dxf.get("height", 0.0))


def _ratio(window: Viewport) -> float:
    """Return units of the model in a unit of paper."""
    return float(window.dxf.view_height) / float(window.dxf.height)
