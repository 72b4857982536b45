"""A person's corrections, applied to a reading; what no longer fits is told and left out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from service.domain.edits import AddWall, Edit, EraseWalls, Exclude, Include, Move
from service.domain.findings import Finding, Value
from worker.geometry.drawing.reading.clipping import cut_line, cut_wall, share_inside
from worker.geometry.drawing.reading.file_frame import Box, FileFrame, box_of_id, outline, turn_of_id
from worker.geometry.drawing.reading.moved_lines import walls_of_lines
from worker.geometry.drawing.reading.reading import Column, Reading, RemovedStroke, Wall

Progress = Callable[[str, float], None]
Item = Wall | Column | RemovedStroke

MOVED = "moved by a person"
ADDED = "added by a person"
ERASED = "erased by a person"
EXCLUDED = "in a region that a person excluded"
NOT_INCLUDED = "outside of the regions that a person included"
_TOLERANCE = 0.002
_MOSTLY = 0.5


def apply_edits(reading: Reading, edits: Sequence[Edit], *, progress: Progress | None = None) -> Reading:
    """Return the reading with the edits applied in their order.

    Nothing vanishes: what is erased, excluded or moved away from the walls is set aside with its reason. An
    edit that finds nothing to work on (a stroke that is not there within 0.2 % of the sheet's longer side,
    a polygon with no wall in it, a wall that lies off the sheet) is left out, and a finding
    ``edit-does-not-fit`` names its index.

    Parameters
    ----------
    reading : Reading
        As the file gives it; coordinates of edits are the file's own (`FileFrame`).
    edits : sequence of Edit
        All `include` regions act together, where the first of them stands.
    progress : callable, optional
        Told the stage and the share done; what it raises ends the work.
    """
    if not edits:
        return reading
    desk = _Desk(reading, [edit for edit in edits if isinstance(edit, Include)])
    misfits = []
    for index, edit in enumerate(edits):
        if progress is not None:
            progress("edits", index / len(edits))
        if why := desk.apply(edit):
            message = f"Edit {index} ({edit.action}) does not fit and was left out: {why}."
            values: dict[str, Value] = {"edit": index, "action": edit.action}
            misfits.append(Finding("edit-does-not-fit", "warning", message, values))
    return replace(
        reading,
        walls=tuple(desk.walls),
        columns=tuple(desk.columns),
        removed=tuple(desk.removed),
        findings=(*reading.findings, *misfits),
        counts={**reading.counts, "edits": len(edits), "edits_applied": len(edits) - len(misfits)},
    )


class _Desk:
    """Hold a reading while it is corrected; every method that takes an edit returns why it does not fit."""

    def __init__(self, reading: Reading, includes: Sequence[Include]) -> None:
        self.walls = list(reading.walls)
        self.columns = list(reading.columns)
        self.removed = list(reading.removed)
        self._frame = FileFrame.of(reading)
        self._tolerance = _TOLERANCE * self._frame.extent
        self._extent = _extent(reading)
        self._metres = reading.metres_a_unit
        self._knows_metres = reading.unit == "m"
        self._includes = list(includes)
        self._boxes: dict[int, tuple[Item, Box]] = {}

    def apply(self, edit: Edit) -> str:
        """Apply an edit; return why it does not fit, or nothing."""
        if isinstance(edit, Move):
            return self._move(edit)
        if isinstance(edit, AddWall):
            return self._add(edit)
        if isinstance(edit, Include):
            return self._include(edit)
        if isinstance(edit, Exclude):
            return self._cut_away(self._region(edit.within), EXCLUDED)
        assert isinstance(edit, EraseWalls)
        return self._cut_away(self._region(edit.within), ERASED)

    def _region(self, points: Sequence[tuple[float, float]]) -> Any:
        return shapely.make_valid(shapely.Polygon(self._frame.to_drawing(points)))

    def _move(self, edit: Move) -> str:
        if edit.within:
            moved = self._take_within(edit)
            missing = "" if moved else "nothing that could be moved lies in the polygon"
        else:
            moved, lost = self._take_named(edit)
            missing = f"{lost} is not there any more" if lost else ""
        if edit.to == "wall":
            lines = [line for item in moved for line in outline(item) if len(line) > 1]
            self.walls += walls_of_lines(lines, metres_per_unit=self._metres, reason=MOVED)
        elif edit.to == "column":
            self.columns += [column for item in moved if (column := _column(item)) is not None]
            self.removed += [
                RemovedStroke(outline(item), "other", f"{MOVED}, but no outline of a column")
                for item in moved
                if _column(item) is None
            ]
        else:
            self.removed += [RemovedStroke(outline(item), edit.to, MOVED) for item in moved]
        return missing

    @property
    def _items(self) -> list[Item]:
        items: list[Item] = [*self.walls]
        items += self.columns
        items += self.removed
        return items

    def _take_named(self, edit: Move) -> tuple[list[Item], str]:
        """Take the named strokes off the desk, but for those that are in the layer already.

        The second value is the first name that nothing fits any more; the others are taken all the same.
        """
        items = self._items
        boxes = np.array([self._box(item) for item in items]).reshape(-1, 4)
        taken: list[Item] = []
        lost = ""
        for name in edit.strokes:
            item = self._find(name, items, boxes)
            if item is None:
                lost = lost or name
            elif _layer(item) != edit.to and not any(item is one for one in taken):
                taken.append(item)
        self._drop(taken)
        return taken, lost

    def _box(self, item: Item) -> Box:
        """Return the box of an item in the file's own coordinates; the item is held, so its id stays its."""
        if id(item) not in self._boxes:
            self._boxes[id(item)] = (item, self._frame.boxes([item])[0])
        return self._boxes[id(item)][1]

    def _find(self, name: str, items: Sequence[Item], boxes: NDArray[np.float64]) -> Item | None:
        """Return the item whose box is nearest to the one in the name, if it is near enough."""
        off = np.abs(boxes - np.array(box_of_id(name))).max(axis=1, initial=0.0)
        near = [int(i) for i in np.flatnonzero(off <= self._tolerance)]
        if not near:
            return None
        rank = {i: (_letter(items[i]) != name[0], float(off[i])) for i in near}
        best = [i for i in near if rank[i] == min(rank.values())]
        return items[best[min(turn_of_id(name), len(best)) - 1]]

    def _drop(self, taken: Sequence[Item]) -> None:
        gone = {id(item) for item in taken}
        self.walls = [w for w in self.walls if id(w) not in gone]
        self.columns = [c for c in self.columns if id(c) not in gone]
        self.removed = [r for r in self.removed if id(r) not in gone]

    def _take_within(self, edit: Move) -> list[Item]:
        """Take off the desk what lies in the polygon by more than half, a set-aside stroke line by line."""
        region = self._region(edit.within)
        shapely.prepare(region)
        corners = np.array(edit.within)
        low, high = corners.min(axis=0) - self._tolerance, corners.max(axis=0) + self._tolerance
        taken: list[Item] = []
        kept: list[RemovedStroke] = []
        for item in self._items:
            x0, y0, x1, y1 = self._box(item)
            apart = x1 < low[0] or y1 < low[1] or x0 > high[0] or y0 > high[1]
            if apart or _layer(item) == edit.to or (edit.of and _layer(item) not in edit.of):
                continue
            if not isinstance(item, RemovedStroke):
                taken += [item] if share_inside(outline(item), region) > _MOSTLY else []
                continue
            inside = [share_inside((line,), region) > _MOSTLY for line in item.lines]
            if any(inside):
                self._drop([item])
                taken.append(_of_lines(item, inside))
                kept += [] if all(inside) else [_of_lines(item, [not one for one in inside])]
        self._drop(taken)
        self.removed += kept
        return taken

    def _add(self, edit: AddWall) -> str:
        line = self._frame.to_drawing(edit.line)
        if not shapely.LineString(line).intersects(self._extent):
            return "the wall lies off the drawing"
        thickness = edit.thickness_m
        if thickness is None or not self._knows_metres:
            solid = [w.thickness for w in self.walls if w.thickness > 0]
            thickness = float(np.median(solid)) if solid else 0.0
        self.walls.append(replace(Wall.of(line, thickness=thickness), reason=ADDED))
        return ""

    def _include(self, edit: Include) -> str:
        """Keep what lies in the include regions; the first of them acts for all."""
        own = self._region(edit.within)
        if not any(
            own.intersects(_shape(item)) for item in self._items if not isinstance(item, RemovedStroke)
        ):
            return "there is no wall in the polygon"
        if self._includes and edit in self._includes:
            kept = shapely.union_all([self._region(one.within) for one in self._includes])
            self._includes = []
            self._cut_away(self._extent.buffer(self._extent.length).difference(kept), NOT_INCLUDED)
        return ""

    def _cut_away(self, region: Any, reason: str) -> str:
        """Set aside what of walls and columns lies in the region; columns by more than half."""
        shapely.prepare(region)
        walls: list[Wall] = []
        gone: list[RemovedStroke] = []
        for wall in self.walls:
            left = cut_wall(wall, region)
            walls += left
            if not left:
                gone.append(RemovedStroke(wall.faces, "other", reason))
            elif left[0] is not wall:
                lines = tuple(piece for face in wall.faces for piece in cut_line(face, region, inside=True))
                gone += [RemovedStroke(lines, "other", reason)] if lines else []
        out = [c for c in self.columns if share_inside((c.outline,), region) > _MOSTLY]
        gone += [RemovedStroke(outline(c), "other", reason) for c in out]
        if not gone:
            return "there is no wall in the polygon"
        self.walls = walls
        self.columns = [c for c in self.columns if not any(c is one for one in out)]
        self.removed += gone
        return ""


def _layer(item: Item) -> str:
    if isinstance(item, RemovedStroke):
        return item.layer
    return "wall" if isinstance(item, Wall) else "column"


def _letter(item: Item) -> str:
    if isinstance(item, RemovedStroke):
        return "s"
    return "w" if isinstance(item, Wall) else "c"


def _of_lines(stroke: RemovedStroke, which: Sequence[bool]) -> RemovedStroke:
    return replace(
        stroke, lines=tuple(line for line, is_in in zip(stroke.lines, which, strict=True) if is_in)
    )


def _shape(item: Item) -> Any:
    return shapely.MultiLineString([line for line in outline(item) if len(line) > 1])


def _column(item: Item) -> Column | None:
    """Return the outline of a column: the hull of the strokes, where it has an area."""
    hull = shapely.convex_hull(shapely.MultiPoint(np.vstack(outline(item))))
    if hull.geom_type != "Polygon":
        return None
    return Column(np.array(hull.exterior.coords)[:-1])


def _extent(reading: Reading) -> Any:
    """Return the rectangle around the sheet and all that was read."""
    items: list[Item] = [*reading.walls, *reading.columns, *reading.removed]
    lines = [line for item in items for line in outline(item)]
    if not lines:
        return shapely.box(0.0, 0.0, *reading.sheet)
    points = np.vstack([np.stack([line.min(axis=0), line.max(axis=0)]) for line in lines])
    low, high = np.minimum(points.min(axis=0), 0.0), np.maximum(points.max(axis=0), reading.sheet)
    return shapely.box(*low, *high)
