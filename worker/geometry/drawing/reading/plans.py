"""Several plans on one sheet: groups of walls with bare paper between them."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from service.domain.findings import Finding
from service.domain.geojson import Geometry
from worker.geometry.drawing.reading.file_frame import FileFrame, boxes_of
from worker.geometry.drawing.reading.reading import Reading

_APART = 2.0
_CELL = 0.25
_MOST_CELLS = 2_000
_LEAST_SIDE = 3.0
_LEAST_SHARE = 0.2
_LONGEST_SHARE = 0.6
_MARGIN = 0.5
_MOST = 50
_NO_LINK = frozenset({"frame", "text", "speck", "grid", "dimension", "small"})


def several_plans(reading: Reading) -> Finding | None:
    """Return the finding ``several-plans`` where the walls fall into groups that could each be a plan.

    Between two groups 2 m of paper are bare, but for texts, dimensions, frames and lines across most of the
    sheet; each group has at least a fifth of the largest one's walls, and their boxes do not overlap.
    Buildings that stand apart on a site plan are found too: a person decides. Its place is a
    polygon for each plan in the file's own coordinates, the ring of an edit that includes it.
    """
    if len(reading.walls) < 2:
        return None
    metres = reading.metres_a_unit
    boxes = _groups(reading, metres)
    alone = [i for i, box in enumerate(boxes) if not _overlaps(box, np.delete(boxes, i, axis=0))]
    if len(alone) < 2:
        return None
    frame = FileFrame.of(reading)
    plans = [_corners(boxes[i], _MARGIN / metres, frame) for i in alone[:_MOST]]
    return Finding(
        "several-plans",
        "warning",
        f"The walls stand in {len(alone)} groups with bare paper between them: if the sheet shows several "
        "plans, include one of them by an edit.",
        {"plans": len(alone)},
        Geometry.polygons(plans),
    )


def _groups(reading: Reading, metres: float) -> NDArray[np.float64]:
    """Return the boxes (G, 4) around the walls of each large group: low x, low y, high x, high y."""
    centres = [w.centre for w in reading.walls]
    points = np.vstack(centres)
    low, extent = points.min(axis=0), float(np.ptp(points, axis=0).max())
    cell = max(_CELL / metres, extent / _MOST_CELLS, 1e-9)
    size = np.ceil((points.max(axis=0) - low) / cell).astype(int) + 1
    drawn = np.zeros((int(size[1]), int(size[0])), dtype=np.uint8)
    lines = [*centres, *_links(reading, _LONGEST_SHARE * extent)]
    end = np.cumsum([len(line) for line in lines]).tolist()
    cells = _cells(np.concatenate(lines), low, cell)
    cv2.polylines(drawn, [cells[a:b] for a, b in pairwise([0, *end])], isClosed=False, color=1)
    reach = max(3, round(_APART / metres / cell)) | 1
    _, label = cv2.connectedComponents(cv2.dilate(drawn, np.ones((reach, reach), np.uint8)))
    first = [_cells(c[:1], low, cell)[0] for c in centres]
    group = np.array([label[y, x] for x, y in first])
    length = np.bincount(group, weights=[w.length for w in reading.walls])
    large = np.flatnonzero(length >= max(_LEAST_SHARE * length.max(), 1e-9))
    lows, highs = np.full((2, len(length), 2), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(lows, group, [c.min(axis=0) for c in centres])
    np.maximum.at(highs, group, [c.max(axis=0) for c in centres])
    boxes: NDArray[np.float64] = np.hstack([lows, highs])[large]
    wide = (boxes[:, 2:] - boxes[:, :2]).min(axis=1) >= _LEAST_SIDE / metres
    return np.asarray(boxes[wide])


def _links(reading: Reading, longest: float) -> list[NDArray[np.float64]]:
    """Return the strokes that join what they touch to one plan: doors, windows, furniture, stairs ..."""
    lines = [
        line
        for stroke in reading.removed
        if stroke.layer not in _NO_LINK
        for line in stroke.lines
        if len(line)
    ]
    boxes = boxes_of(lines, [len(line) for line in lines])
    short = (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0) <= longest
    return [lines[n] for n in np.flatnonzero(short).tolist()]


def _cells(line: NDArray[np.float64], low: NDArray[np.float64], cell: float) -> NDArray[np.int32]:
    return np.clip(np.floor((line - low) / cell), -30_000, 30_000).astype(np.int32)


def _overlaps(box: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    apart = (others[:, :2] > box[2:]).any(axis=1) | (others[:, 2:] < box[:2]).any(axis=1)
    return bool((~apart).any())


def _corners(box: NDArray[np.float64], margin: float, frame: FileFrame) -> list[list[float]]:
    x0, y0, x1, y1 = box + margin * np.array([-1.0, -1.0, 1.0, 1.0])
    ring = frame.to_file(np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]))
    return [[round(float(x), 4), round(float(y), 4)] for x, y in ring]
