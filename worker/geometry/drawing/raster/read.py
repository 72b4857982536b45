"""A raster drawing to its walls (paper, section 2.2, steps 1 and 2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.domain.errors import NoWallsFound
from service.domain.findings import Finding
from worker.geometry.drawing.raster import cleanup, pens
from worker.geometry.drawing.raster.dashes import dashed
from worker.geometry.drawing.raster.frames import frames
from worker.geometry.drawing.raster.ink import Ink, drop_dust, find_ink
from worker.geometry.drawing.raster.pairs import find_pairs, regular_patterns
from worker.geometry.drawing.raster.parts import measure_parts
from worker.geometry.drawing.raster.strokes import Strokes, find_strokes
from worker.geometry.drawing.raster.style import by_darkness, is_filled
from worker.geometry.drawing.raster.support import with_confidence
from worker.geometry.drawing.raster.wall_strokes import (
    filled_walls,
    outlined_walls,
    rest,
    single_walls,
    thick_mask,
)
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall
from worker.geometry.drawing.scale.decision import Scale

Progress = Callable[[str, float], None]

_ASSUMED_EXTENT = 30.0
_MOST_DUST = 5_000
_MOSTLY_FACE, _FEW_FACES = 0.3, 0.12
_LEAST_PARTITION, _LEAST_REST = 0.65, 0.1
_LAYERS = {"lane": "symbol", "pattern": "stair", "thin": "other"}
_REASONS = {
    "speck": "free-standing and smaller than 12 cm",
    "dust": "free-standing and smaller than 4 cm; `counts.dust` tells how many, an even selection is shown",
    "text": "free-standing and smaller than 70 cm: a letter, a number or a symbol",
    "symbol": "free-standing and smaller than 2.4 m, and not in the shape of a wall",
    "frame": "the rectangle around everything on the sheet, or a title block on it",
    "lane": "of a figure whose lines lead from dot to dot: lanes, way points or leaders",
    "dashed": "one of a row of free bars: a dashed line",
    "pattern": "one of at least five parallels at one spacing: stairs, planks or tiles",
    "light-pen": "drawn with a clearly lighter pen than the walls",
    "furniture": "filled, but much lighter than the walls",
    "blot": "thick, but too short for a wall and no pier",
    "thin": "thin, in a drawing whose walls are filled",
    "loose": "neither one of two wall faces nor a long line that leads to a wall",
}


def read_raster(grey: NDArray[np.uint8], *, scale: Scale, progress: Progress | None = None) -> Reading:
    """Return the walls of a sheet, and everything that was set aside with its reason.

    A first honest cleaning: what is no wall is told by size, pen weight, dashes, regular rows, parallel
    faces and
    connection. Curved single-line walls and walls of a lighter pen than others may be set aside; furniture
    drawn with the walls' pen and joined to them may stay.

    Parameters
    ----------
    grey : ndarray of shape (H, W), uint8
        255 is bare paper; row 0 is the top.
    scale : Scale
        In metres a pixel. While it is unknown, sizes are judged as if the drawn extent were 30 m, which a
        finding says, and coordinates are pixels.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.

    Returns
    -------
    Reading
        In frame `drawing`: x right, y up, origin at the sheet's lower left.

    Raises
    ------
    NoWallsFound
        If the sheet is blank. Where something is drawn, but nothing looks like a wall, the reading has no
        walls and says so in the finding ``no-walls``: a person may move strokes to the walls.
    ValueError
        If the scale is not positive.
    """
    if scale.metres_per_unit is not None and not scale.metres_per_unit > 0:
        msg = f"a scale is positive, not {scale.metres_per_unit} metres a pixel"
        raise ValueError(msg)
    tell = progress or (lambda _stage, _share: None)
    tell("ink", 0.05)
    metres_per_px = scale.metres_per_unit or _ASSUMED_EXTENT / max(grey.shape)
    ink, dust = drop_dust(find_ink(grey, metres_per_px))
    tell("strokes", 0.2)
    strokes = pens.weigh(ink, find_strokes(ink, ink.mask))
    if not len(strokes):
        raise NoWallsFound("The sheet is blank: nothing on it is darker than its paper.")
    tell("cleanup", 0.55)
    walls, columns, removed, style = _sort_out(ink, strokes, tell)
    size = (grey.shape[1] * metres_per_px, grey.shape[0] * metres_per_px)
    removed += _dust(dust, ink.metres_per_px)
    counts: dict[str, int] = {"dust": len(dust)}
    findings = () if walls else (_no_walls(len(strokes), size, metres_per_px),)
    reading = Reading(
        tuple(walls), tuple(columns), tuple(removed), size, scale, style, findings=findings, counts=counts
    )
    tell("walls", 0.95)
    return reading if scale.metres_per_unit is not None else _in_pixels(reading, metres_per_px)


def _no_walls(strokes: int, size: tuple[float, float], metres_per_px: float) -> Finding:
    return Finding(
        "no-walls",
        "serious",
        f"None of the {strokes} strokes on the sheet looks like a wall. Check the scale: at "
        f"{metres_per_px:.5g} m a pixel the sheet is {size[0]:.1f} x {size[1]:.1f} m. Or move the strokes of "
        "the walls to the layer wall, or draw the walls, by edits.",
    )


@dataclass
class _Sorting:
    """Hold the strokes while they are sorted: `layer` is empty for what is still a candidate."""

    ink: Ink
    strokes: Strokes
    layer: NDArray[np.str_]
    removed: list[RemovedStroke]

    def put(self, name: str, which: NDArray[np.bool_]) -> None:
        self.layer[which & self.candidates] = name

    @property
    def candidates(self) -> NDArray[np.bool_]:
        return np.asarray(self.layer == "", dtype=np.bool_)


def _sort_out(
    ink: Ink, strokes: Strokes, tell: Progress
) -> tuple[list[Wall], list[Column], list[RemovedStroke], str]:
    """Return walls, columns, what was set aside, and the style of the drawing."""
    m = ink.metres_per_px
    sorting = _Sorting(ink, strokes, np.full(len(strokes), "", dtype="<U12"), [])
    parts = measure_parts(ink.mask, m)
    sorting.put("frame", frames(strokes, parts))
    sorting.put("dashed", dashed(strokes, parts, m))
    for name, which in cleanup.small_parts(strokes, parts, m).items():
        sorting.put(name, which)
    sorting.put("lane", cleanup.from_dot_to_dot(strokes, parts, m))
    thick = thick_mask(ink, parts.without(_parts_of(sorting)), _line_width(strokes, m))
    bars, columns, blots = filled_walls(ink, thick, least_pier=2.0 * _line_width(strokes, m, share=0.5))
    sorting.removed += [RemovedStroke((line,), "small", _REASONS["blot"]) for line in blots]
    tell("pairs", 0.7)
    in_thick = _mostly_in(strokes, thick)
    if is_filled(sorting.strokes, bars, sorting.candidates & ~in_thick, ink):
        sorting.put("thin", ~in_thick)
        bars, light = by_darkness(ink, bars)
        walls = bars
        sorting.removed += [RemovedStroke((w.centre,), "furniture", _REASONS["furniture"]) for w in light]
        style = "filled"
    else:
        _set_light_aside(sorting, in_thick)
        lines, style = _line_walls(sorting, thick)
        walls = bars + lines
    walls = with_confidence(walls, filled=len(bars), style=style)
    return walls, columns, sorting.removed + _removed(ink, sorting.strokes, sorting.layer), style


def _set_light_aside(sorting: _Sorting, in_thick: NDArray[np.bool_]) -> None:
    """Set regular rows and what a light pen drew aside; cut strokes where the pen changes."""
    ink, m = sorting.ink, sorting.ink.metres_per_px
    pairs = find_pairs(sorting.strokes, m, among=sorting.candidates)
    sorting.put("pattern", regular_patterns(sorting.strokes, pairs))
    least = pens.lightest_wall_pen(sorting.strokes, pairs, sorting.candidates & ~in_thick, m)
    cut, origin = pens.split_where_lighter(ink, sorting.strokes, least)
    sorting.strokes, sorting.layer = cut, sorting.layer[origin]
    sorting.put("light-pen", cut.weight < least)


def _line_walls(sorting: _Sorting, thick: NDArray[np.bool_]) -> tuple[list[Wall], str]:
    """Return walls drawn in outline or as single lines, and which of the two prevails; note every rest."""
    ink, strokes = sorting.ink, sorting.strokes
    m = ink.metres_per_px
    candidates = sorting.candidates & ~_mostly_in(strokes, thick)
    pairs = find_pairs(strokes, m, among=candidates)
    outlined, used = outlined_walls(ink, strokes, pairs, candidates)
    count = np.array([len(cells) for cells in used])
    face = (
        np.add.reduceat(np.concatenate(used), np.cumsum(count) - count, dtype=np.int64) / count > _MOSTLY_FACE
    )
    if strokes.length[face & candidates].sum() < _FEW_FACES * strokes.length[candidates].sum():
        outlined, used, face = [], [np.zeros_like(cells) for cells in used], np.zeros_like(face)
    own_pen = pens.like_most(strokes, face)
    singles = single_walls(ink, strokes, candidates, face)
    alone = []
    for i in np.flatnonzero(candidates):
        for piece in rest(strokes.ends[i], used[i]):
            length = float(np.hypot(*(piece[1] - piece[0])) * m)
            line = ink.to_drawing(piece)
            if singles[i] and own_pen[i] and length >= _LEAST_PARTITION:
                alone.append(Wall.of(line, thickness=float(strokes.width[i] * m), kind="partition"))
            elif length >= _LEAST_REST:
                sorting.removed.append(RemovedStroke((line,), "other", _REASONS["loose"]))
    prevails = sum(w.length for w in outlined) > sum(w.length for w in alone)
    return outlined + alone, "outlined" if prevails else "single-line"


def _parts_of(sorting: _Sorting) -> NDArray[np.int64]:
    """Return the connected parts of which something was set aside."""
    return np.unique(sorting.strokes.part[~sorting.candidates])


def _line_width(strokes: Strokes, m: float, *, share: float = 0.2) -> float:
    """Return the width [m] that the given share of all length does not exceed."""
    order = np.argsort(strokes.width, kind="stable")
    passed = np.cumsum(strokes.length[order]) / max(float(strokes.length.sum()), 1e-9)
    at = min(int(np.searchsorted(passed, share)), len(order) - 1)
    return float(strokes.width[order[at]] * m)


def _mostly_in(strokes: Strokes, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which strokes run with at least half of nine sample points inside the mask."""
    share = np.linspace(0.0, 1.0, 9)
    xy = strokes.ends[:, :1] + (strokes.ends[:, 1:] - strokes.ends[:, :1]) * share[None, :, None]
    columns = np.clip(np.rint(xy[..., 0]).astype(int), 0, mask.shape[1] - 1)
    rows = np.clip(np.rint(xy[..., 1]).astype(int), 0, mask.shape[0] - 1)
    return np.asarray(mask[rows, columns].mean(axis=1) >= 0.5, dtype=np.bool_)


def _removed(ink: Ink, strokes: Strokes, layer: NDArray[np.str_]) -> list[RemovedStroke]:
    """Return what was set aside: one feature a layer and connected part, and one for all specks."""
    out = []
    gone = np.flatnonzero(layer != "")
    order = gone[np.lexsort((strokes.part[gone], layer[gone]))]
    if not len(order):
        return []
    speck = layer[order] == "speck"
    change = (layer[order][1:] != layer[order][:-1]) | ~speck[1:] & (np.diff(strokes.part[order]) != 0)
    ends = ink.to_drawing(strokes.ends[order].reshape(-1, 2)).reshape(-1, 2, 2)
    bounds = [0, *(np.flatnonzero(change) + 1).tolist(), len(order)]
    for first, last in pairwise(bounds):
        name = str(layer[order[first]])
        out.append(RemovedStroke(tuple(ends[first:last]), _LAYERS.get(name, name), _REASONS[name]))
    return out


def _dust(dust: NDArray[np.float64], edge: float) -> list[RemovedStroke]:
    """Return the specks as one feature of tiny strokes; of a sheet full of them, an even selection."""
    shown = dust[:: max(1, -(-len(dust) // _MOST_DUST))]
    lines = tuple(np.stack([p, p + np.array([edge, 0.0])]) for p in shown)
    return [RemovedStroke(lines, "speck", _REASONS["dust"])] if lines else []


def _in_pixels(reading: Reading, metres_per_px: float) -> Reading:
    """Return the reading in pixels of the sheet, with a finding that says so."""
    finding = Finding(
        "scale-unknown",
        "serious",
        "The scale is not known: coordinates are pixels, and sizes were judged as if the longer side "
        f"of the sheet were {_ASSUMED_EXTENT:g} m.",
    )
    return replace(reading.scaled(1.0 / metres_per_px), findings=(*reading.findings, finding))
